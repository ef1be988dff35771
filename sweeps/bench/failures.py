"""Stability of a step, and where the methods fail.

Without force and stop, eq. (1) has one parameter, zeta = h / p; a step adds p T. The runs use the
kernel.

The method ``to the letter`` is the paper's procedure taken literally, ``vibroimpact.paper``. It
starts from rest at the stop, so figures that need another start are not measured for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from sweeps.bench.method_scenes import EXACT_METHOD, Method
from sweeps.bench.paper_cases import CHATTER
from sweeps.text import table
from vibroimpact import Oscillator, PaperRun, Trajectory, integrate, paper_procedure, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.stability import is_stable, spectral_radius

#: Values of h / p in the table: none, light, half critical, critical, twice critical.
ZETAS = np.array([0.0, 0.1, 0.5, 1.0, 2.0])
#: A limit of p T beyond this counts as no limit.
LONGEST = 10.0
#: Greatest p T and h / p in the chart.
CHART = (4.0, 2.0)

#: Steps of a run, and of a quick run. Growth of less than ``SEEN`` / steps per step is not seen.
CHART_STEPS, CHART_STEPS_QUICK = 200_000, 20_000
SEEN = 1.5 * math.log(2.0)

_PER_PERIOD = 100
# A bracket of the limit is cut ``_CUTS`` times; the ``_PARTS`` fill the lanes of the kernel.
_PARTS, _CUTS = 7, 9

# Blue where motion decays, darker where it decays faster; orange where it grows. In greyscale, too,
# the lightest colour is next to the limit, which is drawn.
_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0)
_COLOURS = ListedColormap(
    ["#08519C", "#3C8CC3", "#86BCDC", "#D6E6F4", "#FDD9B0", "#F6A54C", "#D97706", "#8F4600"]
)
_NORM = BoundaryNorm(_LEVELS, _COLOURS.N, extend="max")
# Rounding may lift a marginal radius above 1 by less than this.
_MARGINAL = 1e-9

#: By integrator and source, the greatest stable p T at ``ZETAS``; inf where every step is stable.
Limits = Mapping[str, Mapping[str, np.ndarray]]


def longest_steps(quick: bool = False) -> Limits:
    """Return the limits of every integrator, by name; `quick` shortens the runs.

    The sources are ``closed``, the table of integrators; ``radius``, the spectral radius of the
    map; and ``run``, the growth in runs.
    """
    steps = CHART_STEPS_QUICK if quick else CHART_STEPS
    return {
        name: {
            "closed": integrator.limit(ZETAS),
            "radius": _first(partial(_unstable, name)),
            "run": _first(partial(run_grows, name, zeta=ZETAS, steps=steps)),
        }
        for name, integrator in INTEGRATORS.items()
    }


def table_of(limits: Limits) -> str:
    """Return a table with a row per integrator and h / p, or a single row if there is no limit."""
    rows = [["integrator", "h/p", "closed form", "spectral radius", "in a run"]]
    for name, limit in limits.items():
        values = np.array([*limit.values()]).T
        if np.isinf(values).all():
            rows.append([name, "each", "every step", *2 * [f"> {LONGEST:g}"]])
            continue
        for zeta, (closed, *measured) in zip(ZETAS, values, strict=True):
            shown_limits = (f"{value:.4f}" for value in measured)
            first = f"{closed:.4f}" if closed > 0.0 else "no step"
            rows.append([name if zeta == ZETAS[0] else "", f"{zeta:g}", first, *shown_limits])
    return (
        "Greatest stable p T of free motion: in closed form, from the spectral radius of\n"
        f"the map, and from the growth in a run\n\n{table(rows, words=1)}\n"
    )


def stability_rows(limits: Limits) -> Iterator[tuple[str, str, str, float]]:
    """Yield every limit as a row of `sweeps.bench.failures.FAILURE_COLUMNS`."""
    for name, limit in limits.items():
        for source, values in limit.items():
            for zeta, value in zip(ZETAS, values, strict=True):
                yield name, f"limit of p T, {source}", f"h/p = {zeta:g}", value


def stability_chart(quick: bool = False) -> Figure:
    """Draw a panel per integrator: the spectral radius of a step, and the limit in closed form.

    The radius is drawn over p T and h / p, on a coarser mesh if `quick`.
    """
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
        panel.set_xlim(0.0, step[-1])
        panel.set_ylim(0.0, zeta[-1])
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


def run_grows(integrator: str, step: np.ndarray, zeta: np.ndarray, steps: int) -> np.ndarray:
    """Whether free motion grows in a run of the kernel of so many `steps`, over p T and h / p.

    It grows if its greatest section in the last third of the run is more than twice that in the
    first third, or is not a number.
    """
    step, zeta = np.broadcast_arrays(step, zeta)
    points = np.zeros(step.size, dtype=POINT)
    points["h"], points["p"] = zeta.ravel(), 1.0
    points["omega"] = 2.0 * math.pi / (_PER_PERIOD * step.ravel())
    points["clearance"], points["x0"] = np.finfo(float).max, -1.0
    periods = steps // _PER_PERIOD
    out = integrate(
        points,
        integrator=integrator,
        impact="plain",
        steps_per_period=_PER_PERIOD,
        transient=0,
        periods=periods,
        impacts=0,
    )
    size = np.maximum(np.abs(out["poincare_x"]), np.abs(out["poincare_v"]))
    first, last = size[:, : periods // 3], size[:, -(periods // 3) :]
    return ~(last.max(axis=1) <= 2.0 * first.max(axis=1)).reshape(step.shape)


def _unstable(integrator: str, step: np.ndarray) -> np.ndarray:
    return ~is_stable(integrator, step, ZETAS)


def _first(unstable: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the least p T at which `unstable` holds, for each of ``ZETAS``; inf beyond LONGEST."""
    low, high = np.zeros_like(ZETAS), np.full_like(ZETAS, LONGEST)
    none = ~unstable(high)
    columns = np.arange(ZETAS.size)
    for _ in range(_CUTS):
        marks = np.linspace(low, high, _PARTS + 1)
        beyond = np.vstack([unstable(marks[1:-1]), np.ones_like(none)])
        k = beyond.argmax(axis=0)
        low, high = marks[k, columns], marks[k + 1, columns]
    return np.where(none, math.inf, high)


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

#: Steps per period, unless said otherwise; the rule ``exact`` chooses its own.
STEPS = 100
#: Marks a figure that is a failure.
MARK = "!"
# Columns of a table that fit into 80 characters.
_PER_TABLE = 4
#: Columns of the CSV file.
FAILURE_COLUMNS = ("method", "figure", "scene", "value")

Figures = Mapping[tuple[Method, str], float]

#: Long chatters that never become complete: nothing rests.
ENDLESS = (Oscillator(h=0.5, R=0.8, omega=0.6, f=1.0), Oscillator(h=0.5, R=0.95, omega=0.4, f=1.0))
#: The paper's fully dissipative case: four impacts per period, the slowest at the speed 0.0365.
PAPER = Oscillator(h=0.5, R=0.5, omega=1.0, f=1.0)
PAPER_IMPACTS, PAPER_SLOWEST = 80, 0.036454221377120
#: The first flight touches the stop at this time, at the speed 0.0039.
TOUCHING, TOUCH_TIME = Oscillator(h=0.1, R=0.8, omega=3.0383, f=1.0), 2.8308
#: Free motion without any loss.
FREE_MOTION = Oscillator(h=0.0, R=1.0, omega=101.37 / 100.0, f=0.0)
#: Two attractors: 1 impact in 1 period, and 3 impacts in 2 periods.
COEXISTING = Oscillator(h=0.02, R=0.8, omega=1.3, f=1.0)
#: At four steps per period p T = pi, beyond the limit of every integrator that has one.
COARSE, COARSE_STEPS = Oscillator(h=0.0, R=0.8, omega=0.5, f=1.0), 4


class Failure(NamedTuple):
    """One kind of failure."""

    name: str  # name of the figure
    scene: str  # description of the run and of the figure
    digits: str  # format of the figure
    fails: Callable[[float], bool]  # whether a figure is a failure
    to_the_letter: bool  # whether it can be measured for the method ``to the letter``
    #: Returns the figure of a method; NaN if it cannot be measured.
    measure: Callable[[Method], float]


FAILURES: list[Failure] = []


def _in_failures(
    name: str, scene: str, digits: str, fails: Callable[[float], bool], to_the_letter: bool = True
) -> Callable[[Callable[[Method], float]], None]:
    """Return a decorator that adds a function to ``FAILURES``."""
    return lambda measure: FAILURES.append(
        Failure(name, scene, digits, fails, to_the_letter, measure)
    )


def measure_failures(methods: Sequence[Method] = TESTED_METHODS) -> Figures:
    """Return every figure, by method and name of the failure."""
    return {
        (method, failure.name): failure.measure(method)
        if failure.to_the_letter or method != LETTER
        else math.nan
        for method in methods
        for failure in FAILURES
    }


def failure_tables(figures: Figures) -> Iterator[str]:
    """Yield the figures in tables that fit a terminal, a row per method, with their scenes."""
    yield f"Where methods fail ({MARK}), at {STEPS} steps per period unless said otherwise\n"
    methods = dict.fromkeys(method for method, _ in figures)
    for start in range(0, len(FAILURES), _PER_TABLE):
        columns = FAILURES[start : start + _PER_TABLE]
        rows = [("method", *(f"{failure.name} " for failure in columns))]
        for method in methods:
            cells = (failure_text(failure, figures[method, failure.name]) for failure in columns)
            rows.append((" ".join(method), *cells))
        scenes = "\n".join(f"  {failure.name}: {failure.scene}" for failure in columns)
        yield f"{table(rows, words=1)}\n\n{scenes}\n"


def failure_text(failure: Failure, figure: float) -> str:
    """Return a figure as text, marked if it is a failure."""
    if math.isnan(figure):
        return ""
    if math.isinf(figure) and not failure.fails(figure):
        return "never "
    return f"{figure:{failure.digits}}{MARK if failure.fails(figure) else ' '}"


def failure_rows(figures: Figures) -> Iterator[tuple[str, str, str, float]]:
    """Yield every figure as a row of ``FAILURE_COLUMNS``."""
    scenes = {failure.name: failure.scene for failure in FAILURES}
    for (method, name), figure in figures.items():
        if not math.isnan(figure):
            yield " ".join(method), name, scenes[name], figure


def _motion_by(
    method: Method, oscillator: Oscillator, periods: int, x0: float = 0.0, v0: float = 0.0
) -> Trajectory | PaperRun:
    """Run an oscillator, by default from rest at the stop."""
    if method == LETTER:
        return paper_procedure(oscillator, periods, STEPS)
    return simulate(oscillator, periods, *method, _steps_of(method), x0, v0)


def _steps_of(method: Method, steps: int = STEPS) -> int | None:
    return None if method.impact == "exact" else steps


@_in_failures(
    "stalls at",
    "chatter, h = 0, R = 0.3, omega = 0.3: time at which time stops advancing",
    ".2f",
    lambda t: t < math.inf,
)
def _stall(method: Method) -> float:
    run = _motion_by(method, CHATTER, 2)
    if isinstance(run, PaperRun):
        return math.inf if run.stalled_at is None else run.stalled_at
    return run.t[-1] if run.status.failed else math.inf


@_in_failures(
    "at rest", "the same: impacts while the mass in truth rests", ".0f", lambda count: count > 0
)
def _impacts_at_rest(method: Method) -> float:
    run = _motion_by(method, CHATTER, 1)
    if isinstance(run, PaperRun) and run.stalled_at is not None:
        return math.nan
    begin, end = simulate(CHATTER, 1).rests[0]
    return float(np.count_nonzero((run.impact_t > begin + 1e-6) & (run.impact_t < end - 1e-6)))


@_in_failures(
    "false rests",
    "h = 0.5, R = 0.8, omega = 0.6 and h = 0.5, R = 0.95, omega = 0.4: rests in 20 periods "
    "each, where nothing rests",
    ".0f",
    lambda count: count > 0,
    to_the_letter=False,  # the literal procedure has no rests
)
def _false_rests(method: Method) -> float:
    runs = [simulate(oscillator, 20, *method, _steps_of(method)) for oscillator in ENDLESS]
    return float(sum(len(run.rests) for run in runs))


@_in_failures(
    "depth",
    "fully dissipative case of the paper: deepest penetration, over the speed of the fastest "
    "impact times T",
    ".2f",
    lambda depth: depth > 1e-12,
)
def _penetration(method: Method) -> float:
    run = _motion_by(method, PAPER, 20)
    return run.max_penetration * PAPER.omega * STEPS / (2.0 * math.pi * run.impact_v.max())


@_in_failures(
    "touch from",
    "a touch that begins and ends within a step: least depth that is seen, over |a| T^2 / 8; "
    "below 0, an impact is seen where there is no touch",
    ".2f",
    lambda depth: abs(depth) > 1e-6,
    to_the_letter=False,
)
def _smallest_touch(method: Method) -> float:
    """Bisect for the depth, with the free flight x = cos t that starts 2.5 steps before its top."""
    T = 2.0 * math.pi / STEPS
    x0, v0 = math.cos(2.5 * T), math.sin(2.5 * T)
    missed, seen = -40.0, 40.0
    for _ in range(50):
        depth = 0.5 * (missed + seen)
        stop = 1.0 - depth * T * T / 8.0
        osc = Oscillator(h=0.0, R=0.8, omega=1.0, f=0.0, clearance=max(stop, x0))
        impacts = _motion_by(method, osc, 1, x0, v0).impact_t
        missed, seen = (missed, depth) if (impacts < 5.0 * T).any() else (depth, seen)
    return round(seen, 9) + 0.0


@_in_failures(
    "graze at",
    "h = 0.1, R = 0.8, omega = 3.0383: time of the first impact, a touch at t = 2.8308",
    ".4f",
    lambda t: abs(t - TOUCH_TIME) > 2.0 * math.pi / (TOUCHING.omega * STEPS),
)
def _first_graze(method: Method) -> float:
    return _motion_by(method, TOUCHING, 3).impact_t[0]


@_in_failures(
    "energy",
    "f = 0, h = 0, R = 1, T = 2 pi / 101.37: share of the energy after 100 impacts",
    ".3g",
    lambda share: abs(share - 1.0) > 0.005,
    to_the_letter=False,
)
def _energy(method: Method) -> float:
    return _motion_by(method, FREE_MOTION, 60, x0=-1.0).impact_v[99] ** 2


@_in_failures(
    "impacts",
    "fully dissipative case of the paper: impacts in 20 periods, of which there are 80",
    ".0f",
    lambda count: count != PAPER_IMPACTS,
)
def _impacts(method: Method) -> float:
    return float(len(_motion_by(method, PAPER, 20).impact_t))


@_in_failures(
    "slowest",
    "the same: speed of the slowest impact, which is 0.0365",
    ".4f",
    lambda speed: abs(speed - PAPER_SLOWEST) > 0.05 * PAPER_SLOWEST,
)
def _slowest_impact(method: Method) -> float:
    run = _motion_by(method, PAPER, 20)
    return run.impact_v[run.impact_t > 10 * PAPER.forcing_period].min()


@_in_failures(
    "astray",
    "h = 0.02, R = 0.8, omega = 1.3, two attractors: of 64 starts, those that end on the wrong one",
    ".0f",
    lambda count: count > 0,
    to_the_letter=False,
)
def _astray(method: Method) -> float:
    starts = [(x, v) for x in np.linspace(-3.0, 0.0, 8) for v in np.linspace(-2.0, 2.0, 8)]
    points = np.concatenate([COEXISTING.at(*start) for start in starts])
    options: dict[str, Any] = {"transient": 1500, "periods": 60}
    true = integrate(points, **options)["impacts_per_period"]
    options |= method._asdict() | {"steps_per_period": _steps_of(method)}
    impacts = integrate(points, **options)["impacts_per_period"]
    return float(np.count_nonzero(~(np.abs(impacts - true) < 0.1)))


@_in_failures(
    "p T = pi",
    "h = 0, R = 0.8, omega = 0.5 at 4 steps per period: greatest speed in 400 periods, which "
    "is 1.62; inf: overflow",
    ".3g",
    lambda speed: not 1.62 / 1.5 <= speed <= 1.5 * 1.62,
    to_the_letter=False,
)
def _greatest_speed(method: Method) -> float:
    run = simulate(COARSE, 400, *method, _steps_of(method, COARSE_STEPS))
    return math.inf if run.status.failed else float(np.abs(run.v).max())
