"""The longest stable step: in closed form, from the map, from runs that grow or not; its chart.

Without force and stop, eq. (1) has one parameter, zeta = h / p; a step adds p T. The runs use the
kernel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from sweeps.text import table
from vibroimpact import integrate
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
