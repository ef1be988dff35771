"""The motion of one point of a sweep: time history and phase plane, recorded or computed again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.selection import Cut, Setting, recorded
from sweeps.messages import Refused, in_units
from sweeps.plotting.canvas import PAGE, Page, add_legend, figure_of, in_style, new_picture
from sweeps.plotting.labels import add_title, label, mathtext
from sweeps.plotting.marks import draw_stop
from sweeps.plotting.palette import BLUE, ORANGE, VERMILION
from sweeps.store import VARIABLES
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import exact_samples, simulate

#: Forcing periods that are computed where no trajectory was recorded.
PERIODS = 4

_RECORDED = ("trajectory_t", "trajectory_x", "trajectory_v")


@dataclass(frozen=True)
class _Motion:
    """The rows of a trajectory.

    Attributes
    ----------
    point : Dataset
        The point of the sweep.
    oscillator : Oscillator
    t, x, v : ndarray, shape (n,)
        Time from the first row on [time], displacement and velocity; NaN-free.
    begin : float
        omega t at the first row [rad].
    """

    point: xr.Dataset
    oscillator: Oscillator
    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    begin: float


@in_style
def trajectory(
    dataset: xr.Dataset,
    *,
    at: Cut | None = None,
    periods: int | None = None,
    page: Page = PAGE,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Draw the motion of one point as the paper does: x over t, v over t, v over x.

    Impacts are marked, and so are samples beyond the stop, of which the deepest is stated. Of the
    integrator ``exact`` the exact flow is drawn between the events, not the steps.

    Parameters
    ----------
    dataset, at
        As for `sweeps.plotting.bifurcation`.
    periods : int, optional
        Forcing periods to compute with the method of the sweep, from the last state of the section
        on. By default the trajectory of the file is drawn or, where there is none, ``PERIODS``.
    page : Page, optional
        Its limits are those of x over t.
    ax : three Axes, optional
        The panels to draw into, by default those of a new figure.

    Returns
    -------
    Figure
        That of `ax`, or the new one.

    Raises
    ------
    Refused
        If nothing was recorded at this point.
    """
    setting = Setting.of(dataset)
    if periods is None and all(name in dataset for name in _RECORDED):
        motion = _read(dataset, setting, at)
    else:
        motion = _continue(dataset, setting, at, PERIODS if periods is None else periods)
    panels = _new_panels(page) if ax is None else list(ax)
    _draw(panels, motion, setting.method["integrator"] == "exact")
    over_time, velocity, phase_plane = panels
    time, x, v = (_attributes(name, setting.units) for name in _RECORDED)
    over_time.set_ylabel(label(x, "\n"))
    velocity.set(xlabel=label(time), ylabel=label(v, "\n"))
    phase_plane.set(xlabel=label(x), ylabel=label(v))
    phase_plane.set_title(_depth_text(motion.x - motion.oscillator.clearance))
    page.set_limits(over_time)
    handles = [handle for panel in panels for handle in panel.get_legend_handles_labels()[0]]
    add_legend(phase_plane, handles)
    start, turns = motion.begin / motion.oscillator.omega, motion.begin / (2.0 * np.pi)
    record = f"$t_0 = {mathtext(start)}$, after {turns:.6g} forcing periods"
    add_title(over_time, page, setting, motion.point, record)
    return figure_of(over_time)


def _attributes(name: str, units: Mapping[str, str]) -> xr.DataArray:
    """Return the attributes of a variable, which the file may not have; time from the start on."""
    variable = VARIABLES[name]
    symbol = "t - t_0" if name == "trajectory_t" else variable.symbol
    unit = in_units(variable.unit, units)
    return xr.DataArray(attrs={"long_name": variable.long_name, "units": unit, "symbol": symbol})


def _read(dataset: xr.Dataset, setting: Setting, at: Cut | None) -> _Motion:
    """Return the trajectory of the file at a point."""
    point, (t, x, v) = recorded(dataset, _RECORDED, at)
    oscillator = _oscillator(setting, point)
    return _Motion(point, oscillator, t - t[0], x, v, float(oscillator.omega * t[0]))


def _continue(dataset: xr.Dataset, setting: Setting, at: Cut | None, periods: int) -> _Motion:
    """Compute the motion that follows the last state of the section at a point.

    With an impact rule that lets the mass pass the stop, a state beyond it starts no motion: the
    last one that is not beyond it is taken.
    """
    if periods < 1:
        raise Refused(f"periods = {periods} is not allowed; expected: an integer >= 1")
    point, (x, v) = recorded(dataset, ("poincare_x", "poincare_v"), at)
    oscillator, method = _oscillator(setting, point), setting.method
    allowed = np.flatnonzero(x <= oscillator.clearance)
    if not len(allowed):
        raise Refused("every recorded state of the section is beyond the stop at this point")
    last = int(allowed[-1])
    motion = simulate(
        oscillator,
        periods,
        method["integrator"],
        method["impact"],
        method["steps_per_period"],
        x0=float(x[last]),
        v0=float(v[last]),
        phase=setting.phase,
    )
    if motion.status.failed:
        raise Refused(f"the motion cannot be computed at this point: {motion.status.meaning}")
    turns = setting.record.get("transient", 0) + last + 1
    begin = setting.phase + 2.0 * np.pi * turns
    return _Motion(point, oscillator, motion.t - motion.t[0], motion.x, motion.v, begin)


def _oscillator(setting: Setting, point: xr.Dataset) -> Oscillator:
    names = [field.name for field in fields(Oscillator)]
    return Oscillator(**{name: setting.value(name, point) for name in names})


def _new_panels(page: Page) -> list[Axes]:
    """Return the panels of x and v over time and of the phase plane, which is beside or below."""
    narrow = page.width is not None and page.width < 5.0
    if narrow:
        figure = new_picture(page, page.width or 0.0, 5.2)
        layout, heights = "x;v;p", [1.0, 1.0, 1.6]
    else:
        figure = new_picture(page, 6.2, 4.2)
        layout, heights = "xp;vp", [1.0, 1.0]
    panels = figure.subplot_mosaic(layout, height_ratios=heights)
    panels["v"].sharex(panels["x"])
    panels["x"].tick_params(labelbottom=False)
    figure.align_ylabels([panels["x"], panels["v"]])
    panels["p"].locator_params(axis="x", nbins=5)
    return [panels["x"], panels["v"], panels["p"]]


def _draw(panels: Sequence[Axes], motion: _Motion, exact: bool) -> None:
    """Draw the motion, its impacts, the samples beyond the stop, and the stop."""
    t, x, v, clearance = motion.t, motion.x, motion.v, motion.oscillator.clearance
    # Two rows at the same time are the two sides of an impact.
    impact = np.append((np.diff(t) == 0.0) & (v[:-1] > 0.0), False)
    beyond = x > clearance
    shift = motion.begin / motion.oscillator.omega
    drawn = (t, x, v)
    if exact:
        samples = exact_samples(motion.oscillator, t + shift, x, v)
        drawn = (samples[0] - shift, *samples[1:])
    look: dict[str, Any] = {
        "color": BLUE,
        "linewidth": 0.9 if len(t) < 5000 else 0.4,
        "zorder": 2.0,
    }
    marks = ((impact, ORANGE, "impacts"), (beyond, VERMILION, "samples beyond the stop"))
    for panel, (abscissa, ordinate) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        line = drawn[abscissa], drawn[ordinate]
        panel.plot(*line, **look, rasterized=len(line[0]) > 50_000)
        for where, colour, text in marks:
            if where.any():
                rows = (t, x, v)[abscissa][where], (t, x, v)[ordinate][where]
                (points,) = panel.plot(*rows, "o", color=colour, zorder=3.0)
                points.set(markersize=2.5, markeredgewidth=0)
                points.set_label(text if panel is panels[-1] else "_")
    draw_stop(panels[0].axhline, clearance, label=False)
    draw_stop(panels[2].axvline, clearance)
    panels[0].margins(x=0.01)


def _depth_text(depth: np.ndarray) -> str:
    if depth.max() <= 0.0:
        return "no sample beyond the stop"
    mantissa, exponent = f"{depth.max():.1e}".split("e")
    return f"deepest penetration {mantissa}e{int(exponent)}"
