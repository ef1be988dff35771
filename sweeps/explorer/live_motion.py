"""The motion at the mark: its time history, its phase portrait, and a text with its class."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from html import escape
from typing import NamedTuple

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import Button, ColumnDataSource, Div, Span
from bokeh.plotting import figure

from sweeps.engine.block_results import Results
from sweeps.errors import Refused
from sweeps.explorer.figures import label_live_axis, value_text
from sweeps.explorer.live_diagram import numbers
from sweeps.explorer.view import View
from sweeps.explorer.worker import Step
from sweeps.opened.coordinates import refuse_unrecorded
from sweeps.opened.dataset import oscillator_of
from sweeps.opened.motions import motions_from, orbit_of_motion
from sweeps.opened.trajectories import continued, periods_shown
from sweeps.plotting.style import BLUE, ORANGE
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.points.regimes import ON_ITS_WAY, SETTLED, Regime, on_its_way
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
    points, found = config.sweep.grid.points(), numbers(config)
    nothing = np.empty((3, 0)), np.empty((3, 0))
    status = Status(found["status"][0])
    if status.failed:
        return Drawn(status.meaning, *nothing)
    (motion,) = motions_from(config.sweep.spec, points, found)
    text, m = _in_words(motion, found, config.record.phase), int(motion["m"])
    states = found["poincare_x"][0], found["poincare_v"][0]
    try:
        if not np.isfinite(states).any():
            refuse_unrecorded(status, "poincare_x")
        periods = min(periods_shown(m), _MOST) if m else _UNREPEATED
        oscillator, begun = oscillator_of(points[0]), float(points["phase"][0])
        drawn = continued(oscillator, config, states, periods, begun)
    except Refused as error:
        return Drawn(f"{text}; {error}", *nothing)
    start = np.array([[drawn.rows[0, 0]], [0.0], [0.0]])
    return Drawn(text, drawn.flow(per_period=64) - start, drawn.impacts - start)


def _in_words(motion: np.void, found: Results, phase: float) -> str:
    """Return a text on a motion, given the results of its point alone."""
    regime = Regime(motion["regime"])
    if regime is Regime.PERIODIC:
        going = on_its_way(motion["regime"], found["orbit_distance"][0])
        said = (ON_ITS_WAY if going else SETTLED).removesuffix(" m/q")
        text = f"{said} {motion['m']}/{motion['q']}"
        with suppress(OrbitError):  # an orbit of another impact rule
            first, second = orbit_of_motion(motion, phase).multipliers.astype(complex)
            shown = f"{first.real:.4g} and {second.real:.4g}"
            if first.imag:
                shown = f"{first.real:.4g} ± {abs(first.imag):.4g} i"
            return f"{text}; Floquet multipliers {shown}"
    else:
        text = regime.word
    if regime is Regime.REST:
        return f"{text}, {100.0 * found['rest_fraction'][0]:.3g} % of the time"
    if "lyapunov" in found:
        first, second = found["lyapunov"][0]
        text += f"; Lyapunov exponents {first:.4g} and {second:.4g} per unit time"
    return text


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
                label_live_axis(axis, f"trajectory_{name}", view, size, pixels)
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
