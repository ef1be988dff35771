"""The column of sliders, fields and choices beside the picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    Checkbox,
    Div,
    LayoutDOM,
    NumericInput,
    PrintfTickFormatter,
    Select,
    Slider,
)

from sweeps.analysis.selection import COORDINATES
from sweeps.explorer.view import View, window_around
from sweeps.explorer.words import symbol
from sweeps.plotting.labels import as_variable
from vibroimpact.oscillator import PARAMETERS

_WIDTH = 232
_COMPACT = ".bk-input { height: 24px; min-height: 24px; padding: 0 6px; }"
#: The fields of the record: their title, whether they hold an integer, and what they are.
_RECORD = {
    "transient": ("transient", True, "forcing periods before anything is shown"),
    "periods": ("periods", True, "forcing periods that are shown"),
    "phase": ("phase", False, "forcing phase of the section, 0 to 2π [rad]"),
}


class Controls:
    """The widgets that change the view.

    Parameters
    ----------
    view : View
    change : callable
        Is given a function from the present view to the one that is asked for.
    save : callable
        Writes the configuration of what is shown.
    """

    def __init__(
        self,
        view: View,
        change: Callable[[Callable[[View], View]], None],
        save: Callable[[], None],
    ) -> None:
        self._change, self._showing = change, False
        self.axis = self._choice("abscissa", [(name, meaning(name)) for name in PARAMETERS])
        names = [(name, as_variable(name).attrs["long_name"]) for name in COORDINATES]
        self.ordinate = self._choice("ordinate", names)
        self.axis.on_change("value", self._on(View.with_axis))
        self.ordinate.on_change(
            "value", self._on(lambda view, name: replace(view, ordinate=name, ylim=None))
        )
        self.fields: dict[str, NumericInput] = {}
        self.sliders: dict[str, Slider] = {}
        rows: list[LayoutDOM] = [self._parameter(name, view) for name in PARAMETERS]
        records = [self._record(name) for name in _RECORD]
        self.exact = Checkbox(label="exact branches", name="exact", width=_WIDTH)
        self.exact.on_change("active", self._on(lambda view, on: replace(view, exact=on)))
        save_button = Button(label="save as YAML", name="save", width=_WIDTH, height=30)
        save_button.on_click(save)
        self.status, self.error = _message("status", "inherit"), _message("error", "#B00020")
        self.layout = column(
            self.ordinate, self.axis, *rows, row(*records, spacing=4), self.exact, save_button,
            self.status, self.error, width=_WIDTH + 12, spacing=1, sizing_mode="stretch_height",
            styles={"overflow-y": "auto", "overflow-x": "hidden", "padding-left": "4px"},
        )  # fmt: skip

    def _on(self, changed: Callable[[View, Any], View]) -> Callable[[str, Any, Any], None]:
        """Return a callback of a property; nothing happens while the widgets show a view."""

        def callback(attr: str, old: object, new: Any) -> None:
            if not self._showing:
                self._change(lambda view: changed(view, new))

        return callback

    def _choice(self, title: str, options: list[tuple[str, str]]) -> Select:
        """Return a choice with its title."""
        return Select(
            options=options, name=title, title=title, width=_WIDTH, margin=(1, 0, 1, 0),
            stylesheets=[_COMPACT],
        )  # fmt: skip

    def _parameter(self, name: str, view: View) -> LayoutDOM:
        """Return the symbol, the field and the slider of a parameter."""
        parameter, value = PARAMETERS[name], view.values[name]
        tip = f"{parameter.meaning}: {parameter.allowed}"
        low, high = window_around(name, view.values)
        field = NumericInput(mode="float", name=name, width=74, height=24, margin=(0, 2, 0, 0))
        field.update(stylesheets=[_COMPACT], format=PrintfTickFormatter(format="%.7g"))
        slider = Slider(
            start=low, end=high, value=value, step=(high - low) / 400.0, show_value=False,
            title=None, width=110, height=22, margin=(2, 4, 0, 8), name=f"{name} slider",
        )  # fmt: skip
        changed = self._on(partial(_with_value, name=name))
        field.on_change("value", changed)
        slider.on_change("value", changed)
        self.fields[name], self.sliders[name] = field, slider
        label = Div(text=f'<span title="{tip}">{symbol(name)}</span>', width=22)
        label.styles = {"text-align": "right", "padding-top": "4px"}
        return row(label, field, slider, spacing=2)

    def _record(self, name: str) -> LayoutDOM:
        """Return the field of a number of the record."""
        title, whole, tip = _RECORD[name]
        field = NumericInput(
            mode="int" if whole else "float", name=name, title=title, width=72, margin=(2, 0, 2, 0)
        )
        field.stylesheets = [_COMPACT]
        field.description = tip
        self.fields[name] = field
        field.on_change("value", self._on(partial(_with_record, name=name)))
        return field

    def show(self, view: View) -> None:
        """Set every widget to a view."""
        self._showing = True
        self.axis.value, self.ordinate.value = view.axis, view.ordinate
        self.exact.active = view.exact
        for name, value in view.values.items():
            slider = self.sliders[name]
            if not slider.start <= value <= slider.end:
                low, high = window_around(name, view.values)
                slider.update(start=low, end=high, step=(high - low) / 400.0)
            slider.value = self.fields[name].value = value
        for name in _RECORD:
            self.fields[name].value = view.record[name]
        self._showing = False


def _message(name: str, colour: str) -> Div:
    """Return the place of messages, which repeat what files, addresses and fields hold."""
    styles = {"color": colour, "white-space": "pre-line", "overflow-wrap": "anywhere"}
    return Div(name=name, width=_WIDTH, text="", styles=styles, render_as_text=True)


def meaning(name: str) -> str:
    """Return the symbol of a parameter and what it is."""
    return f"{symbol(name)}: {PARAMETERS[name].meaning}"


def _with_value(view: View, value: float | None, *, name: str) -> View:
    return view.moved(**{name: math.nan if value is None else float(value)})


def _with_record(view: View, value: float | None, *, name: str) -> View:
    return replace(view, record={**view.record, name: math.nan if value is None else value})
