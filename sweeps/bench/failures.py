"""Charts where a step is unstable; each `Failure`: scenes and figures of where methods fail.

Without force and stop, eq. (1) has one parameter, zeta = h / p; a step adds p T.

The method ``to the letter`` is the paper's procedure taken literally, ``vibroimpact.paper``. It
starts from rest at the stop, so figures that need another start are not measured for it. The
docstring of a failure is the description that is printed.
"""
# ruff: noqa: D205

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from sweeps.bench.accuracy import EXACT_METHOD, Method
from sweeps.bench.paper_cases import CASES, CHATTER
from sweeps.text import table
from vibroimpact import Oscillator, PaperRun, integrate, paper_procedure, simulate
from vibroimpact.step.integrators import INTEGRATORS, spectral_radius

#: Values of h / p in the table: none, light, half critical, critical, twice critical.
ZETAS = np.array([0.0, 0.1, 0.5, 1.0, 2.0])
#: Greatest p T and h / p in the chart.
CHART = (4.0, 2.0)

#: Steps per period, unless said otherwise.
STEPS = 100

# Blue where motion decays, darker where it decays faster; orange where it grows. In greyscale, too,
# the lightest colour is next to the limit, which is drawn.
_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0)
_COLOURS = ListedColormap(
    ["#08519C", "#3C8CC3", "#86BCDC", "#D6E6F4", "#FDD9B0", "#F6A54C", "#D97706", "#8F4600"]
)
_NORM = BoundaryNorm(_LEVELS, _COLOURS.N, extend="max")
# Rounding may lift a marginal radius above 1 by less than this.
_MARGINAL = 1e-9


def limit_table() -> str:
    """Return the greatest stable p T, by integrator and h / p; in one row if there is no limit."""
    rows = [["integrator", "h/p", "greatest p T"]]
    for name, integrator in INTEGRATORS.items():
        limits = integrator.limit(ZETAS)
        if np.isinf(limits).all():
            rows.append([name, "each", "every step"])
            continue
        for zeta, limit in zip(ZETAS, limits, strict=True):
            shown_limit = f"{limit:.4f}" if limit > 0.0 else "no step"
            rows.append([name if zeta == ZETAS[0] else "", f"{zeta:g}", shown_limit])
    return f"Greatest stable p T of free motion, in closed form\n\n{table(rows, words=1)}\n"


def stability_chart(quick: bool = False) -> Figure:
    """Draw a panel per integrator: spectral radius and limit over p T and h / p."""
    columns, rows = (81, 41) if quick else (401, 201)
    step, zeta = np.linspace(0.0, CHART[0], columns), np.linspace(0.0, CHART[1], rows)
    down = math.ceil(len(INTEGRATORS) / 2)
    figure = Figure(figsize=(4.4, 0.8 + 1.4 * down), layout="constrained")
    panels = figure.subplots(down, 2, sharex=True, sharey=True, squeeze=False)
    for panel in panels.flat[len(INTEGRATORS) :]:
        panel.set_visible(False)
    for panel, (name, integrator) in zip(panels.flat, INTEGRATORS.items(), strict=False):
        radius = spectral_radius(name, step, zeta[:, None]) - _MARGINAL
        panel.pcolormesh(step, zeta, radius, norm=_NORM, cmap=_COLOURS, rasterized=True)
        limit = integrator.limit(zeta)
        panel.plot(limit, zeta, color="black", linewidth=1.4)
        panel.set_title(f"{name}, no limit" if np.isinf(limit).all() else name, pad=3.0)
        panel.set(xlim=(0.0, step[-1]), ylim=(0.0, zeta[-1]))
    for panel in panels[:, 0]:
        panel.set_ylabel("damping $h/p$ [1]")
    for panel in panels[-1]:
        panel.set_xlabel("step $p\\,T$ [rad]")
    bar = figure.colorbar(
        ScalarMappable(_NORM, _COLOURS), ax=panels, location="bottom", aspect=40, pad=0.01
    )
    bar.set_label("spectral radius of a step of free motion; above 1 it grows")
    bar.ax.axvline(1.0, color="black", linewidth=1.4)
    bar.set_ticks(_LEVELS, labels=[f"{level:g}" for level in _LEVELS])
    return figure


LETTER = Method("newmark", "to the letter")
#: The integrator ``exact`` with the rules of time stepping is left out: it fails as ``rk4`` does.
TESTED_METHODS: Sequence[Method] = (
    LETTER,
    *(
        Method(integrator, impact)
        for integrator in ("euler", "semi-implicit-euler", "verlet", "newmark", "rk4")
        for impact in ("plain", "reduced-step", "cubic")
        if impact != "cubic" or integrator in ("newmark", "rk4")
    ),
    EXACT_METHOD,
)

#: Marks a figure that is a failure.
MARK = "!"
# Columns of a table that fit into 80 characters.
_PER_TABLE = 4

Figures = Mapping[tuple[Method, str], float]
FAILURES: list[Failure] = []

#: The paper's case with four impacts per period, and the speed of the slowest.
PAPER, PAPER_SLOWEST = CASES["fully dissipative"], 0.036454221377120
#: The first flight touches the stop at this time, at the speed 0.0039.
TOUCHING, TOUCH_TIME = Oscillator(h=0.1, R=0.8, omega=3.0383, f=1.0), 2.8308
TOUCH_STEP = TOUCHING.forcing_period / STEPS


def measure_failures() -> Figures:
    """Return every figure, by method and name of the failure; NaN if it cannot be measured."""
    return {
        (method, failure.name): failure.measure(method)
        if failure.to_the_letter or method != LETTER
        else math.nan
        for method in TESTED_METHODS
        for failure in FAILURES
    }


def failure_tables(figures: Figures) -> Iterator[str]:
    """Yield the figures in tables that fit a terminal, a row per method, with their scenes."""
    yield f"Where methods fail ({MARK}), at {STEPS} steps per period unless said otherwise\n"
    for start in range(0, len(FAILURES), _PER_TABLE):
        columns = FAILURES[start : start + _PER_TABLE]
        rows = [("method", *(f"{failure.name} " for failure in columns))]
        for method in TESTED_METHODS:
            cells = (_shown(failure, figures[method, failure.name]) for failure in columns)
            rows.append((" ".join(method), *cells))
        scenes = "\n".join(f"  {failure.name}: {failure.scene}" for failure in columns)
        yield f"{table(rows, words=1)}\n\n{scenes}\n"


def _shown(failure: Failure, figure: float) -> str:
    """Return a figure as text, marked if it is a failure."""
    if math.isnan(figure):
        return ""
    if math.isinf(figure) and not failure.fails(figure):
        return "never "
    return f"{figure:{failure.digits}}{MARK if failure.fails(figure) else ' '}"


def figure_table(figures: Figures) -> pd.DataFrame:
    """Return all limits and figures, a row for each."""
    rows = [
        (name, "limit of p T", f"h/p = {zeta:g}", limit)
        for name, integrator in INTEGRATORS.items()
        for zeta, limit in zip(ZETAS, integrator.limit(ZETAS), strict=True)
    ]
    scenes = {failure.name: failure.scene for failure in FAILURES}
    rows += [(" ".join(method), name, scenes[name], v) for (method, name), v in figures.items()]
    return pd.DataFrame(rows, columns=["method", "figure", "scene", "value"]).dropna()


@dataclass
class Failure:
    """One kind of failure, and the decorator that adds its function to ``FAILURES``."""

    name: str  # name of the figure
    digits: str  # format of the figure
    low: float  # the range of figures that are no failure
    high: float
    to_the_letter: bool = True  # whether it can be measured for the method ``to the letter``

    def __call__(self, measure: Callable[[Method], float]) -> None:
        """Take the function that returns the figure of a method, and its docstring."""
        self.measure, self.scene = measure, " ".join((measure.__doc__ or "").split()).strip(".")
        FAILURES.append(self)

    def fails(self, figure: float) -> bool:
        """Whether a figure is a failure."""
        return figure < self.low or figure > self.high


def _run(
    method: Method, oscillator: Oscillator, periods: int, x0: float = 0.0, v0: float = 0.0
) -> Any:
    """Run an oscillator, by default from rest at the stop."""
    if method == LETTER:
        return paper_procedure(oscillator, periods, STEPS)
    return simulate(oscillator, periods, *method, _steps_of(method), x0, v0)


def _steps_of(method: Method, steps: int = STEPS) -> int | None:
    return None if method.impact == "exact" else steps


@Failure("stalls at", ".2f", math.inf, math.inf)
def _stall(method: Method) -> float:
    """chatter, h = 0, R = 0.3, omega = 0.3: time at which time stops advancing."""
    run = _run(method, CHATTER, 2)
    if isinstance(run, PaperRun):
        return math.inf if run.stalled_at is None else run.stalled_at
    return run.t[-1] if run.status.failed else math.inf


@Failure("at rest", ".0f", 0, 0)
def _impacts_at_rest(method: Method) -> float:
    """the same: impacts while the mass in truth rests."""
    run = _run(method, CHATTER, 1)
    if isinstance(run, PaperRun) and run.stalled_at is not None:
        return math.nan
    begin, end = simulate(CHATTER, 1).rests[0]
    return float(np.count_nonzero((run.impact_t > begin + 1e-6) & (run.impact_t < end - 1e-6)))


@Failure("false rests", ".0f", 0, 0, to_the_letter=False)  # it has no rests
def _false_rests(method: Method) -> float:
    """h = 0.5, R = 0.8, omega = 0.6 and h = 0.5, R = 0.95, omega = 0.4: rests in 20 periods each,
    where nothing rests.
    """
    chatters = (
        Oscillator(h=0.5, R=R, omega=omega, f=1.0) for R, omega in ((0.8, 0.6), (0.95, 0.4))
    )
    return float(sum(len(_run(method, chatter, 20).rests) for chatter in chatters))


@Failure("depth", ".2f", 0.0, 1e-12)
def _depth(method: Method) -> float:
    """fully dissipative case of the paper: deepest penetration, over the speed of the fastest
    impact times T.
    """
    run = _run(method, PAPER, 20)
    return run.max_penetration * PAPER.omega * STEPS / (2.0 * math.pi * run.impact_v.max())


@Failure("touch from", ".2f", -1e-6, 1e-6, to_the_letter=False)
def _smallest_touch(method: Method) -> float:
    """a touch that begins and ends within a step: least depth that is seen, over |a| T^2 / 8; below
    0, an impact is seen where there is no touch.
    """
    # Bisect for the depth, with the free flight x = cos t that starts 2.5 steps before its top.
    T = 2.0 * math.pi / STEPS
    x0, v0 = math.cos(2.5 * T), math.sin(2.5 * T)
    missed, hit = -40.0, 40.0
    for _ in range(50):
        depth = 0.5 * (missed + hit)
        stop = 1.0 - depth * T * T / 8.0
        osc = Oscillator(h=0.0, R=0.8, omega=1.0, f=0.0, clearance=max(stop, x0))
        impacts = _run(method, osc, 1, x0, v0).impact_t
        missed, hit = (missed, depth) if (impacts < 5.0 * T).any() else (depth, hit)
    return round(hit, 9) + 0.0


@Failure("graze at", ".4f", TOUCH_TIME - TOUCH_STEP, TOUCH_TIME + TOUCH_STEP)
def _first_graze(method: Method) -> float:
    """h = 0.1, R = 0.8, omega = 3.0383: time of the first impact, a touch at t = 2.8308."""
    return _run(method, TOUCHING, 3).impact_t[0]


@Failure("energy", ".3g", 0.995, 1.005, to_the_letter=False)
def _energy(method: Method) -> float:
    """f = 0, h = 0, R = 1, T = 2 pi / 101.37: share of the energy after 100 impacts."""
    free = Oscillator(h=0.0, R=1.0, omega=101.37 / 100.0, f=0.0)
    return _run(method, free, 60, -1.0).impact_v[99] ** 2


@Failure("impacts", ".0f", 80, 80)
def _impacts(method: Method) -> float:
    """fully dissipative case of the paper: impacts in 20 periods, of which there are 80."""
    return float(len(_run(method, PAPER, 20).impact_t))


@Failure("slowest", ".4f", 0.95 * PAPER_SLOWEST, 1.05 * PAPER_SLOWEST)
def _slowest_impact(method: Method) -> float:
    """the same: speed of the slowest impact, which is 0.0365."""
    run = _run(method, PAPER, 20)
    return run.impact_v[run.impact_t > 10 * PAPER.forcing_period].min()


@Failure("astray", ".0f", 0, 0, to_the_letter=False)
def _astray(method: Method) -> float:
    """h = 0.02, R = 0.8, omega = 1.3, two attractors: of 64 starts, those that end on the wrong
    one.
    """
    # They have 1 impact in 1 period, and 3 impacts in 2 periods.
    oscillator = Oscillator(h=0.02, R=0.8, omega=1.3, f=1.0)
    starts = [(x, v) for x in np.linspace(-3.0, 0.0, 8) for v in np.linspace(-2.0, 2.0, 8)]
    points = np.concatenate([oscillator.at(*start) for start in starts])
    options: dict[str, Any] = {"transient": 1500, "periods": 60}
    true = integrate(points, **options)["impacts_per_period"]
    options |= method._asdict() | {"steps_per_period": _steps_of(method)}
    impacts = integrate(points, **options)["impacts_per_period"]
    return float(np.count_nonzero(~(np.abs(impacts - true) < 0.1)))


@Failure("p T = pi", ".3g", 1.62 / 1.5, 1.62 * 1.5, to_the_letter=False)
def _greatest_speed(method: Method) -> float:
    """h = 0, R = 0.8, omega = 0.5 at 4 steps per period: greatest speed in 400 periods, which is
    1.62; inf: overflow.
    """
    coarse = Oscillator(h=0.0, R=0.8, omega=0.5, f=1.0)
    run = simulate(coarse, 400, *method, _steps_of(method, 4))
    return math.inf if run.status.failed else float(np.abs(run.v).max())
