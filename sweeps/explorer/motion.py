"""The motion at the mark: its time history, its phase portrait, and a text with its class."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from html import escape
from typing import NamedTuple

import numpy as np
import xarray as xr
from bokeh.layouts import column, row
from bokeh.models import Button, ColumnDataSource, Div, Span
from bokeh.plotting import figure

from sweeps.analysis.dataset import config_of, dataset_of, oscillator_of
from sweeps.analysis.regimes import approaching, classify
from sweeps.analysis.trajectories import continued_motion, periods_shown
from sweeps.errors import Refused
from sweeps.explorer.diagram import numbers
from sweeps.explorer.figures import label_axis, value_text
from sweeps.explorer.view import View
from sweeps.explorer.worker import Step
from sweeps.plotting.style import BLUE, ORANGE
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit
from vibroimpact.points.regimes import ON_ITS_WAY, SETTLED, Regime
from vibroimpact.status import Status

#: Most forcing periods drawn of a periodic motion, and those drawn of other motions.
_MOST, _UNREPEATED = 32, 12


class Drawn(NamedTuple):
    """A motion to draw."""

    text: str  # its class, with its Floquet multipliers or Lyapunov exponents
    line: np.ndarray  # time from a section on, displacement and velocity, shape (3, n)
    impacts: np.ndarray  # the same at the impacts


def motion_at(view: View) -> Drawn:
    """Compute the motion at the mark, for some periods after its last recorded section."""
    config = view.point()
    point = dataset_of(config, {}, numbers(config))
    nothing = np.empty((3, 0)), np.empty((3, 0))
    status = Status(int(point["status"]))
    if status.failed:
        return Drawn(status.meaning, *nothing)
    m, text = _class_in_words(point)
    try:
        periods = min(periods_shown(m), _MOST) if m else _UNREPEATED
        motion = continued_motion(point, None, periods)
    except Refused as error:
        return Drawn(f"{text}; {error}", *nothing)
    start = np.array([[motion.rows[0, 0]], [0.0], [0.0]])
    return Drawn(text, motion.flow(per_period=64) - start, motion.impacts - start)


def _class_in_words(point: xr.Dataset) -> tuple[int, str]:
    """Return the forcing periods per repetition (0: not periodic) and a text on the motion."""
    motion, phase = Regime(int(classify(point))), config_of(point).record.phase
    m, q = int(point["period"]), int(point["period_impacts"])
    said = (ON_ITS_WAY if approaching(point) else SETTLED).removesuffix(" m/q")
    orbit = None
    if motion is Regime.PERIODIC:
        state = float(point["orbit_x"]), float(point["orbit_v"])
        with suppress(OrbitError):  # an orbit of another impact rule
            orbit = periodic_orbit(oscillator_of(point), *state, m, phase)
    if orbit is not None and orbit.m == m:
        first, second = orbit.multipliers.astype(complex)
        shown = f"{first.real:.4g} and {second.real:.4g}"
        if first.imag:
            shown = f"{first.real:.4g} ± {abs(first.imag):.4g} i"
        text = f"{said} {orbit.m}/{orbit.q}; Floquet multipliers {shown}"
        return orbit.m, text
    if motion is Regime.PERIODIC:
        text = f"{said} {m}/{q}"
    else:
        text = motion.word
    if motion is Regime.REST:
        text += f", {100.0 * float(point['rest_fraction']):.3g} % of the time"
    elif "lyapunov" in point:
        first, second = point["lyapunov"].values
        text += f"; Lyapunov exponents {first:.4g} and {second:.4g} per unit time"
    return m if motion is Regime.PERIODIC else 0, text


class MotionPanel:
    """The two figures below the picture, and the text above them; `close` removes the mark."""

    def __init__(self, close: Callable[[], None]) -> None:
        self.line = ColumnDataSource({"t": [], "x": [], "v": []}, name="motion")
        self.impacts = ColumnDataSource({"t": [], "x": [], "v": []}, name="motion: impacts")
        self.text = Div(text="", sizing_mode="stretch_width", margin=(2, 4, 0, 60))
        self.text.name = "motion: text"
        self._stops = [
            Span(dimension=way, location=0.0, line_dash="dashed", line_color="black")
            for way in ("width", "height")
        ]
        self._panels = []
        for (x, y), stop in zip((("t", "x"), ("x", "v")), self._stops, strict=True):
            panel = figure(
                tools="pan,wheel_zoom,box_zoom,reset,save", min_height=110,
                sizing_mode="stretch_both", toolbar_location=None, name=f"motion: {y} over {x}",
            )  # fmt: skip
            panel.line(x, y, source=self.line, color=BLUE, line_width=1.2)
            panel.scatter(x, y, source=self.impacts, color=ORANGE, size=5)
            panel.add_layout(stop)
            panel.xaxis.ticker.desired_num_ticks = 4  # more would overlap on a narrow page
            self._panels.append(panel)
        closing = Button(label="close (Esc)", width=90, height=24, margin=(0, 8, 0, 0))
        closing.on_click(close)
        self.layout = column(
            row(self.text, closing, sizing_mode="stretch_width"),
            row(*self._panels, sizing_mode="stretch_both"),
            sizing_mode="stretch_both",
        )  # fmt: skip

    def steps(self, view: View) -> list[Step]:
        """Return the step that computes the motion, if the view shows it."""
        compute, show = partial(motion_at, view), partial(self._paint, view)
        return [Step("motion", view.point(), compute, show)] if view.shows_motion else []

    def _paint(self, view: View, drawn: Drawn, seconds: float) -> None:
        """Show a motion, the stop and the text."""
        for source, rows in ((self.line, drawn.line), (self.impacts, drawn.impacts)):
            source.data = dict(zip("txv", rows, strict=True))
        for panel, names in zip(self._panels, ("tx", "xv"), strict=True):
            for axis, name, pixels in zip(panel.axis, names, (math.inf, 0.0), strict=True):
                size = float(np.abs(self.line.data[name]).max(initial=0.0))
                label_axis(axis, f"trajectory_{name}", view, size, pixels)
        time = self._panels[0].xaxis
        time.axis_label = time.axis_label.replace("time t", "time t − t₀")
        clearance = view.values["clearance"]
        for stop in self._stops:
            stop.location = clearance
        said = escape(f"{value_text(view.axis, view)}: {drawn.text}")
        self.text.text = (
            f"<b>{said}</b> &nbsp; <span style='color:{ORANGE}'>●</span> impacts, "
            f"┄ stop, x = {value_text('clearance', view)}"
        )
