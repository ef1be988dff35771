"""`LivePage`: answers clicks, tabs and a lost connection with the next view; its thread."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from bokeh.core.templates import FILE
from bokeh.document import Document
from bokeh.events import ClientReconnected, ConnectionLost, DocumentReady, Reset, Tap
from bokeh.layouts import column, row
from bokeh.models import CustomJS, Div, Model, RadioButtonGroup, TabPanel, Tabs, TextInput

from sweeps.config.sweep import SweepConfig
from sweeps.errors import ConfigError, StoreError, SweepError
from sweeps.explorer import controls
from sweeps.explorer.figures import Step, Worker, narrow
from sweeps.explorer.live_diagram import Branches, Diagram
from sweeps.explorer.live_maps import Map
from sweeps.explorer.live_motion import MotionPanel
from sweeps.explorer.view import BASINS_TAB, DIAGRAM_TAB, MAP_TAB, View, write_yaml
from sweeps.text import command, shown_count, three_digits

_ENDED = (
    "<b>vibroimpact explore has ended</b>, or the connection to it is lost: what is shown stays as "
    "it is. Start it again in a terminal."
)
#: The name of the secret in the address, without which the server refuses a browser.
SECRET = "token"
#: Time to wait for all four ends of a window [ms].
_GATHER = 8
_TABS = ("diagram", "map of classes", "basins")
_CONTROLS_LEFT = ":host { flex-direction: row-reverse !important; }"
#: Shows a text while the browser loads the scripts, for about a second. Without an icon a browser
#: requests one whenever the address changes, and Tornado logs each refusal. The name of Bokeh's own
#: template depends on its version.
_TEMPLATE = FILE.environment.from_string(
    """
{% extends "BASE" %}
{% block preamble %}<link rel="icon" href="data:,">{% endblock %}
{% block js_resources %}{% endblock %}
{% block contents %}<p id="opening">vibroimpact explore is opening …</p>
{{ bokeh_js }}{{ super() }}{% endblock %}
""".replace("BASE", FILE.name)
)


class LivePage:
    """One open page; it begins with the view `home`, and saves configurations in `folder`."""

    def __init__(self, document: Document, home: View, folder: Path) -> None:
        self.document, self.home, self.view, self.folder = document, home, home, folder
        self._showing = self._reading = self._waiting = False
        self._rate = ""
        self._saved: tuple[Any, Path] = None, folder  # the last picture, and its file
        self.controls = controls.Controls(home, self._bind, self._save)
        self.diagram = Diagram(self._report)
        self.branches = Branches(self.diagram)
        self.map = Map("map", MAP_TAB, self._report, self.diagram.figure.x_range)
        self.basins = Map("basins", BASINS_TAB, self._report)
        self._pictures = (self.diagram, self.map, self.basins)
        self.motion = MotionPanel(self._close)
        self._line = RadioButtonGroup(labels=["row", "column"], active=0, name="line", height=28)
        parameters = controls.parameter_choices(home.nomenclature)
        self._across = controls.selector("across", "ordinate", parameters)
        self._tabs = self._new_tabs()
        self.worker = Worker(document.add_next_tick_callback, self._refuse)
        self._ended = Div(text=_ENDED, visible=False, name="ended", sizing_mode="stretch_width")
        self._ended.styles = {"background": "#F5D79A", "padding": "6px"}
        self._address = TextInput(visible=False, name="address")
        self._key = TextInput(visible=False, name="key")
        self._connect()
        self._show()
        auto = {"height": "auto", "flex": "none"}
        pictures = column(
            self._tabs, self.motion.layout, sizing_mode="stretch_both", stylesheets=[narrow(**auto)]
        )
        # The Tab key comes to the pictures first; on a wide page they are on the right.
        body = row(
            pictures, self.controls.layout, sizing_mode="stretch_both",
            stylesheets=[_CONTROLS_LEFT, narrow(**auto, flex_direction="column")],
        )  # fmt: skip
        painted = (picture.painted for picture in self._pictures)
        hidden = (self._address, self._key, *painted, self.diagram.fits)
        style: Any = {"sizing_mode": "stretch_both", "stylesheets": [narrow(height="auto")]}
        # Last, because Bokeh visits all models of a document after each change of its models.
        document.add_root(column(self._ended, body, *hidden, **style))
        document.template, document.title = _TEMPLATE, f"{home.name}: vibroimpact"

    def _new_tabs(self) -> Tabs:
        """Return the three tabs: the diagram, the map, and the basins."""
        choices = (self._across, Div(text="a click shows its"), self._line)
        keys = "Keys: arrows, + and −, Home, Enter."
        wrapped: Any = {"sizing_mode": "stretch_width", "styles": {"flex-wrap": "wrap"}}
        abouts = (
            Div(text=f"A click shows the motion there. {keys}", sizing_mode="stretch_width"),
            row(*choices, Div(text="as a diagram."), **wrapped),
            Div(
                text=f"The starts of the oscillator: a click shows the motion of one. {keys}",
                sizing_mode="stretch_width",
            ),
        )
        for title, picture in zip(_TABS, self._pictures, strict=True):
            picture.figure.html_attributes = controls.labelled(title)
        panels = [
            TabPanel(title=title, child=column(about, picture.layout, sizing_mode="stretch_both"))
            for title, about, picture in zip(_TABS, abouts, self._pictures, strict=True)
        ]
        # Part of the controls is seen below, and a finger beside the plot moves the page.
        style = narrow(flex="none", height="75vh")
        return Tabs(tabs=panels, sizing_mode="stretch_both", name="tabs", stylesheets=[style])

    def _connect(self) -> None:
        """Connect the figures, the address, the keys and the connection to the page."""
        document, figures = self.document, [picture.figure for picture in self._pictures]
        self.diagram.fits.on_change("active", self._ranges_changed)
        for picture in self._pictures:
            for name in ("inner_width", "inner_height"):
                picture.figure.on_change(name, partial(self._resized, picture))
            picture.painted.on_change("value", self._painted)
        for plot in figures:
            for model in (plot.x_range, plot.y_range):
                for name in ("start", "end"):
                    model.on_change(name, self._ranges_changed)
            plot.on_event(Reset, lambda _: self.change(self._at_home))
            plot.on_event(Tap, self._tapped)
        self._bind(self._tabs, "active", lambda view, tab: replace(view, tab=tab))
        self._bind(self._across, "value", View.with_across)
        self._bind(
            self.diagram.mark, "location", lambda view, x: view.moved(**{view.axis: float(x)})
        )
        document.config.notify_connection_status = False  # the page shows its own message
        document.on_session_destroyed(lambda _: self.worker.shutdown())
        document.add_periodic_callback(self._show_progress, 200)
        self._key.on_change("value", self._pressed)
        document.js_on_event(DocumentReady, CustomJS(args={"to": self._key}, code=controls.LISTEN))
        document.js_on_event(DocumentReady, CustomJS(code=controls.DESCRIBE))
        # The address holds the view: the page reads it when it opens, then keeps it up to date.
        self._bind(self._address, "value", View.with_query)
        read = CustomJS(args={"to": self._address}, code="to.value = location.search")
        write = (
            f"const secret = new URLSearchParams(location.search).get('{SECRET}');"
            f"history.replaceState(null, '', '?' + from.title + '&{SECRET}=' + secret)"
        )
        document.js_on_event(DocumentReady, read)
        self._address.js_on_change("title", CustomJS(args={"from": self._address}, code=write))
        for event, visible in ((ConnectionLost, "true"), (ClientReconnected, "false")):
            code = f"div.visible = {visible}"
            document.js_on_event(event, CustomJS(args={"div": self._ended}, code=code))

    def _bind(self, model: Model, name: str, changed: Callable[[View, Any], View]) -> None:
        """Let a property of a model change the view to `changed(view, value)`."""
        model.on_change(
            name, lambda attr, old, new: self.change(lambda view: changed(view, new), model)
        )

    def change(self, changed: Callable[[View], View], by: Model | None = None) -> None:
        """Show another view, or why it is refused; ignored while the widgets are being set."""
        if self._showing:
            return
        self.controls.error.text = self.controls.saved.text = ""
        self.controls.refused = None
        try:
            self.view = changed(self._as_zoomed).checked()
        except ConfigError as error:
            self._refuse(str(error))
            self.controls.refused = by
        self._show()

    def _refuse(self, text: str) -> None:
        """Say an error beside those of the same view."""
        said = self.controls.error.text
        if text not in said.splitlines():
            self.controls.error.text = f"{said}\n{text}".strip()

    def _show(self) -> None:
        """Set all parts of the page to the view, and request its pictures."""
        self._showing = True
        for each in (self.controls, *self._pictures, self.branches, self.motion):
            each.show(self.view)
        self._tabs.active, self._across.value = self.view.tab, self.view.across
        self._showing = False
        self._address.title = self.view.query()
        self._compute()

    def _compute(self) -> None:
        """Request the pictures of the view, once the size of the page is known."""
        if not all(self._picture.size):
            return
        # A browser that receives pictures faster than it paints them falls behind.
        self._waiting = not self._picture.is_painted
        self.worker.ask([] if self._waiting else self._steps())

    def _painted(self, attr: str, old: int, new: int) -> None:
        if self._waiting:
            self._compute()

    def _steps(self) -> list[Step]:
        """Return the steps of the open tab, the fastest first; none if they exceed the memory."""
        view = self.view
        try:
            first, *finer = self._picture.steps(view)
        except StoreError as error:
            self._refuse(str(error))
            return []
        branches = self.branches.steps(view, self.diagram.resolution[0])
        # Later steps only make a diagram denser, or a map finer.
        return [first, *self.motion.steps(view), *finer[:1], *branches, *finer[1:]]

    def _resized(self, picture: Diagram | Map, attr: str, old: int, new: int) -> None:
        picture.resize(attr, new)
        picture.show(self._as_zoomed)  # longer labels may fit now
        self._compute()

    def _pressed(self, attr: str, old: str, new: str) -> None:
        """Carry out the action of a key."""
        key = new.partition(" ")[2]
        if key in controls.MOVES:
            self._picture.move(*controls.MOVES[key])
        elif key == "Enter":
            self._mark(*(self.view.values[name] for name, _ in self.view.plane(self.view.tab)))
        elif key == "Home":
            self.change(self._at_home)
        elif key == "Escape":
            self._close()

    def _close(self) -> None:
        """Remove the mark and its motion."""
        self.change(lambda view: replace(view, marked=False))

    def _ranges_changed(self, attr: str, old: Any, new: Any) -> None:
        """Read the window once all four ends have arrived: the browser sends them one by one."""
        if not self._showing and not self._reading:
            self._reading = True
            self.document.add_timeout_callback(self._read_ranges, _GATHER)

    def _read_ranges(self) -> None:
        """Show the view with the windows of the browser."""
        self._reading = False
        if self._as_zoomed != self.view:
            self.change(lambda view: view)

    @property
    def _as_zoomed(self) -> View:
        """The view with the windows of the figures."""
        xlim, ylim = self.diagram.windows
        (_, maplim), (x0lim, v0lim) = self.map.windows, self.basins.windows
        view = replace(self.view, xlim=xlim, maplim=maplim, x0lim=x0lim, v0lim=v0lim)
        return replace(view, ylim=None if self.diagram.fits.active else ylim)

    def _at_home(self, view: View) -> View:
        """Return the view with the original windows of the open tab."""
        home = self.home
        if view.tab == BASINS_TAB:
            return replace(view, x0lim=home.x0lim, v0lim=home.v0lim).moved(**view.values)
        xlim = home.xlim
        if view.axis != home.axis:
            xlim = view.around(view.axis, (view.across, view.maplim))
        if view.tab == DIAGRAM_TAB:
            return replace(view, xlim=xlim, ylim=None)
        unchanged = (view.axis, view.across) == (home.axis, home.across)
        return replace(view, xlim=xlim, maplim=home.maplim if unchanged else view.maplim)

    def _tapped(self, event: Tap) -> None:
        if event.x is not None and event.y is not None:
            self._mark(float(event.x), float(event.y))

    def _mark(self, x: float, y: float) -> None:
        """Mark a point of the open tab; on the map of classes, also show the diagram through it."""
        view = self.view
        if view.tab == DIAGRAM_TAB:
            low, high = view.xlim
            clicked = view.moved(**{view.axis: min(max(x, low), high)})
        elif view.tab == MAP_TAB:
            clicked = view.moved(**{view.axis: x, view.across: y})
            if self._line.active == 1:
                clicked = clicked.with_axis(view.across)
            clicked = replace(clicked, ylim=None, tab=DIAGRAM_TAB)
        else:
            clicked = replace(view.moved(x0=x, v0=y), ylim=None)
        self.change(lambda view: replace(clicked, marked=True))

    def _report(self, config: SweepConfig, points: int, computing: float, seconds: float) -> None:
        """Show the number of computed points of a picture, and the speed."""
        self._picture.wait("")
        size, number = config.sweep.size, points * (config.sweep.known_periods or 0)
        of = "" if points == size else f"{points:,} of "
        periods = f", {shown_count(number, 'forcing period')}" if number else ""
        rate = f": {three_digits(1e-6 * number / computing)} million periods/s" if number else ""
        self._rate = self.controls.status.text = (
            f"{of}{shown_count(size, 'point')}{periods} in {1e3 * computing:.0f} ms{rate}; "
            f"picture after {1e3 * seconds:.0f} ms"
        )

    def _show_progress(self) -> None:
        """Show how long the current step has taken, and that a picture is the previous one."""
        if self._waiting:  # a hidden browser window paints nothing
            self._waiting = False
            self.worker.ask(self._steps())
            return
        name, first, begin = self.worker.busy or ("", False, -math.inf)
        seconds, status, lines = perf_counter() - begin, self._rate, list[str]()
        if seconds > 0.3 and self._picture.source.data["image"]:
            lines.append("this is the previous picture")
        if 0.3 < seconds < math.inf:
            why = ", compiled at the first use" if first and seconds > 1.0 else ""
            status = f"computing: {name}{why}: {seconds:.0f} s"
            lines.append(f"waiting for {name}{why}: {seconds:.0f} s".replace(", ", ",\n"))
        self.controls.status.text = status
        is_late = self.worker.is_late(self._picture.figure.name)
        self._picture.wait(";\n".join(lines) if is_late else "")

    def _save(self) -> None:
        """Write the configuration of the picture, unless this is done, and show the path."""
        self.change(lambda view: view)  # a refused text goes, and steps that failed say so again
        picture = self.view, self._picture.saved(self.view)
        before, path = self._saved
        try:
            if picture != before or not path.exists():
                path = write_yaml(*picture, self.folder)
        except SweepError as error:
            self._refuse(str(error))
        else:
            self._saved = picture, path
            self.controls.saved.text = f"saved: {path}; {command('run', Path(path.name))}"

    @property
    def _picture(self) -> Diagram | Map:
        """The picture of the open tab."""
        return self._pictures[self.view.tab]
