"""`Controls`: sliders, fields and lists beside the picture; keys and screen readers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from urllib.parse import urlencode

from bokeh.layouts import column, row
from bokeh.models import Button, Div, LayoutDOM, Model, Select, Slider, TextInput, Toggle

from sweeps.config.rig import Nomenclature
from sweeps.explorer.figures import narrow, symbol
from sweeps.explorer.view import RECORD_FIELDS, View, window_around
from sweeps.opened.coordinates import COORDINATES
from sweeps.plotting.labels import as_variable, named_unit
from sweeps.text import in_brackets
from vibroimpact.oscillator import PARAMETERS

_WIDTH = 232
#: Low enough for a screen of 400 pixels, and higher for fingers on a narrow page.
_COMPACT = (
    ".bk-input { height: 22px; min-height: 22px; padding: 0 4px; font-size: 12px; }"
    "select.bk-input { padding-right: 18px; }"
    "@media (max-width: 699px) { :host { width: auto !important; height: auto !important; }"
    ".bk-input { height: 34px; min-height: 34px; font-size: 16px; } }"
)
#: The title stands beside the field.
_TITLE_BESIDE = (
    ".bk-input-group { flex-direction: row; align-items: center; gap: 2px; }"
    "label { flex: none; min-width: %dpx; text-align: %s; white-space: nowrap; }"
)
#: The fields of the record, as an address calls them, and their tooltips.
_RECORD = {
    "transient": "forcing periods before anything is shown",
    "periods": "forcing periods that are shown first",
    "section": "forcing phase of the section, 0 to 2π [rad]",
}
#: Lets a property of a model, by its name, change the view: to a function of it and the new value.
Bind = Callable[[Model, str, Callable[[View, Any], View]], None]


class Controls:
    """The widgets that change the view."""

    def __init__(
        self,
        view: View,
        bind: Bind,
        save: Callable[[], None],  # writes the configuration of the picture shown
    ) -> None:
        self._bind = bind
        self.axis = selector("abscissa", "abscissa", parameter_choices(view.nomenclature))
        names = [(name, as_variable(name, view.nomenclature).long_name) for name in COORDINATES]
        self.ordinate = selector("ordinate", "ordinate", names)
        bind(self.axis, "value", View.with_axis)
        bind(self.ordinate, "value", lambda view, name: replace(view, ordinate=name, ylim=None))
        self.fields: dict[str, TextInput] = {}
        self.refused: Model | None = None  # keeps its text: to type the old one is then a change
        self.sliders: dict[str, Slider] = {}
        rows: list[LayoutDOM] = [self._parameter(name, view) for name in PARAMETERS]
        props: Any = {"width": 74, "margin": (0, 0, 2, 0)}
        records = [
            self._field(called, called, title=called, description=tip, **props)
            for called, tip in _RECORD.items()
        ]
        self.exact = Toggle(label="exact branches", name="exact", width=114, height=26)
        bind(self.exact, "active", lambda view, on: replace(view, exact=on))
        save_button = Button(label="save as YAML", name="save", width=100, height=26)
        save_button.on_click(save)
        self.status, self.saved = _message("status", "inherit"), _message("saved", "#005A32")
        self.error = _message("error", "#B00020")
        self.saved.html_attributes = self.error.html_attributes = {"role": "alert"}
        self.layout = column(
            self.ordinate, self.axis, *rows, row(*records, spacing=4), row(self.exact, save_button),
            self.error, self.saved, self.status,
            width=_WIDTH + 12, spacing=1, sizing_mode="stretch_height",
            styles={"overflow-y": "auto", "overflow-x": "hidden", "padding-left": "4px"},
            stylesheets=[narrow(flex="none", align_self="stretch", width="auto", height="auto")],
        )  # fmt: skip

    def _parameter(self, name: str, view: View) -> LayoutDOM:
        """Return the symbol, the field and the slider of a parameter."""
        parameter = view.nomenclature.about(name)
        unit = in_brackets(named_unit(as_variable(name, view.nomenclature)))
        tip = f"{_meaning(name, view.nomenclature)}{unit}, {parameter.allowed}"
        # Room for the longest unit, N s/m, beside the symbol, or for ω t₀.
        beside, typed = (64, 74) if view.nomenclature.rig else (30, 86)
        field = self._field(
            name, view.nomenclature.name(name), height=22, width=beside + typed, margin=0,
            title=symbol(name, view.nomenclature) + (unit if view.nomenclature.rig else ""),
            html_attributes={"title": tip},
        )  # fmt: skip
        field.stylesheets = [_COMPACT, _TITLE_BESIDE % (beside, "right")]
        slider = Slider(
            **_span(name, view), value=view.values[name], show_value=False,
            title=None, height=18, margin=(2, 8, 0, 8), name=f"{name} slider",
            sizing_mode="stretch_width", html_attributes={"title": tip},
        )  # fmt: skip
        self._bind(slider, "value", lambda view, new: view.moved(**{name: float(new)}))
        self.sliders[name] = slider
        return row(field, slider, spacing=2, sizing_mode="stretch_width")

    def _field(self, name: str, called: str, **look: Any) -> TextInput:
        """Return a field for a number in the view, which is called so in an address."""
        field = TextInput(name=name, **look, stylesheets=[_COMPACT])
        self._bind(field, "value", lambda view, text: view.with_query(urlencode({called: text})))
        self.fields[name] = field
        return field

    def show(self, view: View) -> None:
        """Set every widget to the values of a view."""
        self.axis.value, self.ordinate.value = view.axis, view.ordinate
        self.exact.active = view.exact
        for name, value in view.values.items():
            slider = self.sliders[name]
            if not slider.start <= value <= slider.end:
                slider.update(**_span(name, view))
            slider.value = value
        values = {**view.values, **{RECORD_FIELDS[name]: n for name, n in view.record.items()}}
        for name, field in self.fields.items():
            if field is not self.refused:
                field.value = f"{values[name]:.7g}"


def _span(name: str, view: View) -> dict[str, float]:
    """Return the ends and the step of the slider of a parameter."""
    low, high = window_around(name, view.values, view.nomenclature)
    return {"start": low, "end": high, "step": (high - low) / 400.0}


def _message(name: str, colour: str) -> Div:
    """Return an element for messages; as plain text, since they quote files and user input."""
    styles = {"color": colour, "white-space": "pre-line", "overflow-wrap": "anywhere"}
    return Div(name=name, width=_WIDTH, text="", styles=styles, render_as_text=True)


def selector(name: str, title: str, options: list[tuple[str, str]]) -> Select:
    """Return a drop-down list with its title."""
    return Select(
        options=options, name=name, title=title, width=_WIDTH, margin=(1, 0, 1, 0),
        stylesheets=[_COMPACT, _TITLE_BESIDE % (54, "left")],
    )  # fmt: skip


def parameter_choices(nomenclature: Nomenclature) -> list[tuple[str, str]]:
    """Return the options of a drop-down list of parameters."""
    return [(name, _meaning(name, nomenclature)) for name in PARAMETERS]


def _meaning(name: str, nomenclature: Nomenclature) -> str:
    """Return the symbol and the meaning of a parameter."""
    return f"{symbol(name, nomenclature)}: {nomenclature.about(name).meaning}"


#: Effect of a key on the window: shifts as fractions of its width and height, and scale factor.
MOVES = {
    "ArrowLeft": (-0.1, 0.0, 1.0),
    "ArrowRight": (0.1, 0.0, 1.0),
    "ArrowDown": (0.0, -0.1, 1.0),
    "ArrowUp": (0.0, 0.1, 1.0),
    "+": (0.0, 0.0, 0.5),
    "-": (0.0, 0.0, 2.0),
}
#: Sends every key that the widget with the focus does not use to a text field; a counter makes each
#: value different from the last. Enter shows a motion only on a plot, and opens a tab, which Bokeh
#: leaves to the mouse.
LISTEN = """
document.getElementById("opening")?.remove();
let number = 0;
window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const at = event.composedPath()[0], key = event.key;
  if (at.matches?.(".bk-tab") && ["Enter", " "].includes(key)) {
    event.preventDefault();
    at.click();
  }
  if (key !== "Escape" && at.closest?.("input, select, .noUi-handle")) return;
  if (KEYS.includes(key) || (key === "Enter" && at.matches?.(".bk-events"))) {
    event.preventDefault();
    to.value = `${++number} ${key}`;
  }
});
""".replace("KEYS", str([*MOVES, "Home", "Escape"]))
#: Bokeh gives a label or a title to the outermost element of a model only; this hands it on to the
#: element that has the focus. It also puts the tabs before their contents, as the Tab key comes to
#: them, and tells which tab is open, and which buttons are pressed.
DESCRIBE = """
const tell = (element, state) => {
  const set = () => element.setAttribute(state, element.classList.contains("bk-active"));
  new MutationObserver(set).observe(element, {attributeFilter: ["class"]});
  set();
};
const visit = (root, name) => {
  for (const element of root.querySelectorAll("*")) {
    if (element.matches(".bk-events")) element.setAttribute("role", "application");
    if (element.matches(".bk-events, .noUi-handle, input") && name) element.ariaLabel = name;
    if (element.matches(".bk-OnOffButton, .bk-ClickButton")) element.setAttribute("role", "button");
    if (element.matches(".bk-header")) root.prepend(element);
    if (element.matches(".bk-headers-wrapper")) element.setAttribute("role", "tablist");
    if (element.matches(".bk-tab")) {
      element.setAttribute("role", "tab");
      tell(element, "aria-selected");
    }
    if (element.matches(".bk-btn") && !root.host.matches(".bk-Button")) {
      tell(element, "aria-pressed");
    }
    if (element.shadowRoot) visit(element.shadowRoot, element.ariaLabel || element.title || name);
  }
};
visit(document, "");
"""


def labelled(text: str) -> dict[str, str]:
    """Return the attributes of a model for a screen reader: a group with a label."""
    return {"role": "group", "aria-label": text}
