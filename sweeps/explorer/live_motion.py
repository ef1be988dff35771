"""`MotionPanel`: the motion at the mark in time and phase plane, its class, numbers in words."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from html import escape
from typing import NamedTuple

import numpy as np
from bokeh import models
from bokeh.layouts import column, row
from bokeh.plotting import figure

from sweeps.engine.executors import Results, compute_all
from sweeps.errors import Refused
from sweeps.explorer.controls import labelled
from sweeps.explorer.figures import Step, label_of, narrow, value_text
from sweeps.explorer.view import View
from sweeps.opened.coordinates import continue_motion, periods_shown, refuse_unrecorded
from sweeps.opened.motions import motions_from, orbit_of_motion
from sweeps.plotting.style import BLUE, ORANGE
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.oscillator import oscillator_of
from vibroimpact.points.regimes import ON_ITS_WAY, SETTLED, Regime, on_its_way, rest_of
from vibroimpact.status import Status

#: Seconds in which the mass moves through a forcing period.
_SLOW = 2.0
#: Moves the mass along the line, whose tags are the time per second and the length of the mass.
_MOVE = """
const begin = performance.now(), calm = matchMedia("(prefers-reduced-motion: reduce)");
const step = (now) => {
  if (calm.matches) moving.active = false;
  if (!moving.active) return;
  const {t, x, v} = line.data, [rate, length] = line.tags, last = t.length - 1;
  if (last > 0) {
    const time = Math.max(0, (now - begin) / 1000 * rate) % t[last];
    let i = 1;
    while (i < last && t[i] < time) i++;
    const share = (time - t[i - 1]) / (t[i] - t[i - 1]) || 0;
    const at = (values) => values[i - 1] + share * (values[i] - values[i - 1]);
    const data = {t: [time], x: [at(x)], v: [at(v)], back: [at(x) - length]};
    mass.setv({data}, {sync: false});
  }
  requestAnimationFrame(step);
};
requestAnimationFrame(step);
"""
#: Most forcing periods drawn of a periodic motion, and those drawn of other motions.
_MOST, _UNREPEATED = 32, 12


class MotionLines(NamedTuple):
    """A motion to draw."""

    text: str  # its class, with its Floquet multipliers or Lyapunov exponents
    line: np.ndarray  # time from a section on, displacement and velocity, shape (3, n)
    impacts: np.ndarray  # the same at the impacts


def motion_at(view: View) -> MotionLines:
    """Compute the motion at the mark, for some periods after its last recorded section."""
    config = view.point()
    points, results = config.sweep.grid.points(), compute_all(config.sweep)
    nothing = np.empty((3, 0)), np.empty((3, 0))
    status = Status(results["status"][0])
    if status.failed:
        return MotionLines(status.meaning, *nothing)
    (motion,) = motions_from(config.sweep.spec, points, results)
    text, m = _in_words(motion, results, config.record.phase), int(motion["m"])
    states = results["poincare_x"][0], results["poincare_v"][0]
    try:
        if not np.isfinite(states).any():
            refuse_unrecorded(status, "poincare_x")
        periods = periods_shown(m, _MOST, _UNREPEATED)
        oscillator, begun = oscillator_of(points[0]), float(points["phase"][0])
        after = continue_motion(oscillator, config.sweep.spec, states, periods, begun)
    except Refused as error:
        return MotionLines(f"{text}; {error}", *nothing)
    start = np.array([[after.rows[0, 0]], [0.0], [0.0]])
    return MotionLines(text, after.flow(per_period=64) - start, after.impacts - start)


def _in_words(motion: np.void, results: Results, phase: float) -> str:
    """Return a text on a motion, given the results of its point alone."""
    regime = Regime(motion["regime"])
    if regime is Regime.PERIODIC:
        going = on_its_way(motion["regime"], results["orbit_distance"][0])
        said = (ON_ITS_WAY if going else SETTLED).removesuffix(" m/q")
        text = f"{said} {motion['m']}/{motion['q']}"
        with suppress(OrbitError):  # an orbit of another impact rule
            first, second = orbit_of_motion(motion, phase).multipliers.astype(complex)
            numbers_text = f"{first.real:.4g} and {second.real:.4g}"
            if first.imag:
                numbers_text = f"{first.real:.4g} ± {abs(first.imag):.4g} i"
            return f"{text}; Floquet multipliers {numbers_text}"
    elif regime is Regime.REST:
        return f"{rest_of([motion['m']])}, {100.0 * results['rest_fraction'][0]:.3g} % of the time"
    else:
        text = regime.word
    if "lyapunov" in results:
        first, second = results["lyapunov"][0]
        text += f"; Lyapunov exponents {first:.4g} and {second:.4g} per unit time"
    return text


class MotionPanel:
    """The two figures below the picture, and the text above them; `close` removes the mark."""

    def __init__(self, close: Callable[[], None]) -> None:
        self.line = models.ColumnDataSource({"t": [], "x": [], "v": []}, name="motion")
        self.impacts = models.ColumnDataSource({"t": [], "x": [], "v": []}, name="motion: impacts")
        self.text = models.Div(text="", sizing_mode="stretch_width", margin=(2, 4, 0, 60))
        self.text.update(name="motion: text", html_attributes={"role": "status"})
        self.text.stylesheets = [narrow(flex="1 1 100%", margin_left="8px")]
        #: The mass at one moment, and its other end.
        self._mass = models.ColumnDataSource({"t": [], "x": [], "v": [], "back": []}, name="mass")
        self._stops = [
            models.Span(dimension=way, location=0.0, line_dash="dashed", line_color="black")
            for way in ("width", "height")
        ]
        self._panels = []
        said = "motion: displacement over time", "motion: velocity over displacement"
        for (x, y), stop, label in zip((("t", "x"), ("x", "v")), self._stops, said, strict=True):
            panel = figure(
                tools="pan,wheel_zoom,box_zoom,reset,save", min_height=110,
                sizing_mode="stretch_both", toolbar_location=None, name=f"motion: {y} over {x}",
                stylesheets=[narrow(flex="none", height="220px")], html_attributes=labelled(label),
            )  # fmt: skip
            panel.line(x, y, source=self.line, color=BLUE, line_width=1.2)
            panel.scatter(x, y, source=self.impacts, color=ORANGE, size=5)
            panel.scatter(x, y, source=self._mass, color=BLUE, size=9)
            panel.add_layout(stop)
            panel.xaxis.ticker.desired_num_ticks = 4  # more would overlap on a narrow page
            self._panels.append(panel)
        closing = models.Button(label="close (Esc)", width=90, height=24, margin=(0, 8, 0, 0))
        closing.on_click(close)
        self._scene, self._stop = self._new_scene()
        self._moving = models.Toggle(
            label="move the mass", name="moving", width=110, height=24, margin=(0, 4, 0, 0),
            html_attributes={"title": "still where the browser asks for reduced motion"},
        )  # fmt: skip
        parts = {"moving": self._moving, "line": self.line, "mass": self._mass}
        self._moving.js_on_change("active", models.CustomJS(args=parts, code=_MOVE))
        own_height = narrow(height="auto", flex="none")
        content = column(
            row(
                self.text, self._moving, closing, sizing_mode="stretch_width",
                stylesheets=[narrow(flex_wrap="wrap")],
            ),
            self._scene,
            row(
                *self._panels, sizing_mode="stretch_both",
                stylesheets=[narrow(flex_direction="column", height="auto", flex="none")],
            ),
            sizing_mode="stretch_both", stylesheets=[own_height],
        )  # fmt: skip
        # In a column beside tabs, Bokeh would lay out these figures and not those in the tabs.
        self.layout = models.ScrollBox(
            child=content, sizing_mode="stretch_both", stylesheets=[own_height], visible=False
        )

    def _new_scene(self) -> tuple[figure, models.BoxAnnotation]:
        """Return the figure of the mass beside the stop, and the stop."""
        scene = figure(
            tools="", toolbar_location=None, height=40, sizing_mode="stretch_width", min_border=2,
            x_range=models.Range1d(-1.0, 0.0), y_range=models.Range1d(-1.0, 1.0),
            name="motion: mass", html_attributes=labelled("motion: the mass beside the stop"),
        )  # fmt: skip
        scene.axis.visible = scene.grid.visible = False
        scene.outline_line_color = None
        scene.quad(left="back", right="x", bottom=-0.7, top=0.7, source=self._mass, color=BLUE)
        stop = models.BoxAnnotation(left=0.0, fill_color="black", fill_alpha=0.5, line_color=None)
        scene.add_layout(stop)
        return scene, stop

    def show(self, view: View) -> None:
        """Show the motion or nothing."""
        self.layout.visible = view.shows_motion
        self._moving.active = self._moving.active and view.shows_motion

    def steps(self, view: View) -> list[Step]:
        """Return the step that computes the motion, if the view shows it."""
        compute, show = partial(motion_at, view), partial(self._paint, view)
        return [Step("motion", view.point(), compute, show)] if view.shows_motion else []

    def _paint(self, view: View, motion: MotionLines, seconds: float) -> None:
        """Show a motion, the stop and the text."""
        for source, rows in ((self.line, motion.line), (self.impacts, motion.impacts)):
            source.data = dict(zip("txv", rows, strict=True))
        for panel, names in zip(self._panels, ("tx", "xv"), strict=True):
            for axis, name, pixels in zip(panel.axis, names, (math.inf, 0.0), strict=True):
                size = float(np.abs(self.line.data[name]).max(initial=0.0))
                text = label_of(axis, f"trajectory_{name}", view, size, pixels)
                axis.axis_label = text.replace("time t", "time t − t₀")
        clearance = view.values["clearance"]
        for stop in self._stops:
            stop.location = clearance
        self._place(view, clearance)
        said = escape(f"{value_text(view.axis, view)}: {motion.text}")
        self.text.text = (
            f"<b>{said}</b> &nbsp; <span style='color:{ORANGE}'>●</span> impacts, "
            f"┄ stop, x = {value_text('clearance', view)}"
        )

    def _place(self, view: View, clearance: float) -> None:
        """Place the mass at the start of the motion, beside the stop."""
        start = {name: list(self.line.data[name][:1]) for name in "txv"}
        x = [*self.line.data["x"], clearance]
        low, size = min(x), max(x) - min(x) or 1.0
        length = 0.1 * size
        self._scene.x_range.update(start=low - 2.0 * length, end=max(x) + length)
        self._stop.left = clearance
        period = 2.0 * math.pi / float(view.nomenclature.in_model("omega", view.values["omega"]))
        self.line.tags = [period / _SLOW, length]
        self._mass.data = {**start, "back": [at - length for at in start["x"]]}
