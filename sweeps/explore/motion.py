"""The motion at the mark: its time history, its phase plane, and its class in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, Div, Span
from bokeh.plotting import figure

from sweeps.analysis.class_changes import label_of
from sweeps.analysis.motion import Motion, kinds
from sweeps.analysis.nearby_orbit import nearby_orbit
from sweeps.explore.diagram import Results, numbers
from sweeps.explore.view import View
from sweeps.explore.words import axis_label, symbol
from sweeps.explore.worker import Step
from sweeps.plotting.palette import BLUE, ORANGE
from vibroimpact.oscillator import Oscillator
from vibroimpact.status import Status
from vibroimpact.trajectory import exact_samples, simulate

#: Forcing periods that are drawn: of a periodic motion two repetitions, within these limits.
_FEWEST, _MOST = 4, 32
_UNREPEATED = 12

_WORDS = {
    Motion.UNBOUNDED: "unbounded",
    Motion.REST: "with rest on the stop",
    Motion.CHAOTIC: "chaotic",
    Motion.NEUTRAL: "quasi-periodic or unsettled",
    Motion.UNDECIDED: "no repetition found",
}


@dataclass(frozen=True)
class Drawn:
    """A motion to draw.

    Attributes
    ----------
    text : str
        Its class, and its multipliers or exponents.
    line, impacts : ndarray, shape (3, n)
        Time from a passage of the section on, displacement and velocity.
    clearance : float
    """

    text: str
    line: np.ndarray
    impacts: np.ndarray
    clearance: float


def motion_at(view: View) -> Drawn:
    """Compute the motion at the mark, and the periods that follow its last section."""
    config = view.point()
    results = numbers(config)
    values = {field.name: view.values[field.name] for field in fields(Oscillator)}
    osc, phase = Oscillator(**values), config.record.phase
    empty = np.empty((3, 0))
    status = Status(int(results["status"][0]))
    if status.failed:
        return Drawn(status.meaning, empty, empty, osc.clearance)
    m, text = _class_in_words(results, osc, phase, config.record.periods)
    x, v = results["poincare_x"][0], results["poincare_v"][0]
    allowed = np.flatnonzero(x <= osc.clearance)  # some rules let the mass pass the stop
    if not len(allowed):
        return Drawn(f"{text}; beyond the stop at every section", empty, empty, osc.clearance)
    motion = simulate(
        osc,
        min(max(2 * m, _FEWEST), _MOST) if m else _UNREPEATED,
        config.method.integrator,
        config.method.impact,
        config.steps,
        x0=float(x[allowed[-1]]),
        v0=float(v[allowed[-1]]),
        phase=phase,
    )
    rows = np.stack([motion.t, motion.x, motion.v])
    impact = np.append((np.diff(motion.t) == 0.0) & (motion.v[:-1] > 0.0), False)
    line = rows
    if config.method.integrator == "exact":
        line = np.stack(exact_samples(osc, motion.t, motion.x, motion.v, per_period=64))
    start = np.array([[motion.t[0]], [0.0], [0.0]])
    return Drawn(text, line - start, rows[:, impact] - start, osc.clearance)


def _class_in_words(
    results: Results, osc: Oscillator, phase: float, periods: int
) -> tuple[int, str]:
    """Return the forcing periods of a repetition, 0 for none, and what is known of the motion."""
    motion = Motion(int(kinds(results, np.array([osc.omega]), periods)[0]))
    m, q = int(results["period"][0]), int(results["period_impacts"][0])
    label = label_of(motion, m, q)
    record = np.stack([results["poincare_x"][0], results["poincare_v"][0]], axis=1)
    orbit = None
    if motion in (Motion.PERIODIC, Motion.NEUTRAL, Motion.UNDECIDED):
        orbit = nearby_orbit(osc, record, phase, m or None)
    if orbit is not None:
        first, second = orbit.multipliers.astype(complex)
        shown = f"{first.real:.4g} and {second.real:.4g}"
        if first.imag:
            shown = f"{first.real:.4g} ± {abs(first.imag):.4g} i"
        text = f"periodic, class {orbit.m}/{orbit.q}; Floquet multipliers {shown}"
        return orbit.m, text
    text = f"periodic, class {label}" if motion is Motion.PERIODIC else _WORDS[motion]
    if motion is Motion.REST:
        text += f", {100.0 * float(results['rest_fraction'][0]):.3g} % of the time"
    if "lyapunov" in results and motion is not Motion.REST:
        first, second = results["lyapunov"][0]
        text += f"; Lyapunov exponents {first:.4g} and {second:.4g} per unit time"
    return m if motion is Motion.PERIODIC else 0, text


class MotionPanel:
    """The two figures below the diagram, and the words above them.

    Parameters
    ----------
    post : callable
        Runs a function in the thread of the document.
    """

    def __init__(self, post: Callable[[Callable[[], None]], None]) -> None:
        self._post = post
        self.line = ColumnDataSource({"t": [], "x": [], "v": []}, name="motion")
        self.impacts = ColumnDataSource({"t": [], "x": [], "v": []}, name="impacts")
        self.text = Div(name="class", text="", sizing_mode="stretch_width", margin=(2, 4, 0, 60))
        stops = [
            Span(dimension=way, location=0.0, line_dash="dashed", line_color="black")
            for way in ("width", "height")
        ]
        self._stops = stops
        panels = []
        for (x, y), stop in zip((("t", "x"), ("x", "v")), stops, strict=True):
            panel = figure(
                tools="pan,wheel_zoom,box_zoom,reset,save", height=180, min_height=120,
                sizing_mode="stretch_width", toolbar_location=None,
                x_axis_label=f"{axis_label(f'trajectory_{x}')}".replace("time t", "time t − t₀"),
                y_axis_label=axis_label(f"trajectory_{y}"), name=f"{y} over {x}",
            )  # fmt: skip
            panel.line(x, y, source=self.line, color=BLUE, line_width=1.2)
            panel.scatter(x, y, source=self.impacts, color=ORANGE, size=5)
            panel.add_layout(stop)
            panels.append(panel)
        self.layout = column(
            self.text, row(*panels, sizing_mode="stretch_width"), visible=False,
            sizing_mode="stretch_width", name="motion panel",
        )  # fmt: skip

    def show(self, view: View) -> None:
        """Show the panel if a point is marked."""
        self.layout.visible = view.marked

    def steps(self, view: View) -> list[Step]:
        """Return the step that computes the motion, if a point is marked."""
        if not view.marked:
            return []
        compute = partial(motion_at, view)
        return [
            Step("motion", view.point(), compute, lambda drawn, _: self._post(
                partial(self._paint, view, drawn)
            ))
        ]  # fmt: skip

    def _paint(self, view: View, drawn: Drawn) -> None:
        for source, rows in ((self.line, drawn.line), (self.impacts, drawn.impacts)):
            source.data = dict(zip("txv", rows, strict=True))
        for stop in self._stops:
            stop.location = drawn.clearance
        where = f"{symbol(view.axis)} = {view.values[view.axis]:.6g}"
        self.text.text = (
            f"<b>{where}: {drawn.text}</b> &nbsp; <span style='color:{ORANGE}'>●</span> impacts, "
            f"┄ stop, x = {symbol('clearance')} = {drawn.clearance:.6g}"
        )
