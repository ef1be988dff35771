"""`View`: a point in units of page and model, windows around it, switches; YAML.

A `View` is an immutable value. It provides the configuration of every picture, which alone
determines the results, and the query in the address of the page. Its numbers are those that a
reader sees; the names of parameters are those of the model, but for the address and for messages.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self
from urllib.parse import parse_qsl, urlencode

from sweeps.config.groups import OscillatorConfig, RecordConfig
from sweeps.config.loading import load_config
from sweeps.config.rig import Nomenclature
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import as_number
from sweeps.errors import ConfigError
from sweeps.opened.coordinates import COORDINATES
from sweeps.plotting.labels import LARGEST, as_variable
from sweeps.store.replacing import writing
from sweeps.text import command
from vibroimpact.inputs import one_of, refusal
from vibroimpact.oscillator import PARAMETERS, Parameter, oscillator_of

Window = tuple[float, float]

#: The tabs of the page, each with one picture.
DIAGRAM_TAB, MAP_TAB, BASINS_TAB = range(3)
#: What the page records, and what an address calls it.
RECORD_FIELDS = {
    "transient": "transient",
    "periods": "periods",
    "phase": "section",
    "impacts": "impacts",
}
_WINDOWS = ("xlim", "ylim", "maplim", "x0lim", "v0lim")
#: Least width of a window, as a share of its values: every column has another value of the axis.
_LEAST_WINDOW = 1e-11
_CHOSEN = ("axis", "ordinate", "across")
_FLAGS = ("marked", "exact")


def window_around(name: str, values: Mapping[str, float], nomenclature: Nomenclature) -> Window:
    """Return a default window of a parameter around its value at the point `values`."""
    model = _model_values(values, nomenclature)
    value, (length, rate) = model[name], _scales(model)
    if name in ("omega", "p"):
        limits = 0.5 * value, 2.0 * value
    elif PARAMETERS[name].low == 0.0:
        scales = {"h": rate, "f": length * rate * rate, "a": length, "phase": 2.0 * math.tau}
        least = 0.5 * scales.get(name, 1.0)
        limits = 0.0, min(max(least, 2.0 * value), PARAMETERS[name].high)
    elif name == "x0":
        limits = min(value, model["clearance"] - 3.0 * length), model["clearance"]
    else:
        around = max(abs(value), 2.0 * length * (rate if name == "v0" else 1.0))
        least = model["x0"] if name == "clearance" else -math.inf
        limits = max(value - around, least), value + around
    ends = (float(nomenclature.value(name, limit)) for limit in limits)
    low, high = (min(max(end, -LARGEST), LARGEST) for end in ends)
    return low, high


def _model_values(values: Mapping[str, float], nomenclature: Nomenclature) -> dict[str, float]:
    """Return the values of a point in the units of the model."""
    return {name: float(nomenclature.in_model(name, value)) for name, value in values.items()}


def _scales(values: Mapping[str, float]) -> tuple[float, float]:
    """Return the typical length and rate of motions at a point."""
    # The rate is p or, if the force is much faster, of the order of omega. The length is the
    # deflection by the force at that rate, or the clearance if that is larger (but not more than
    # ten times) or the force is 0.
    rate = max(values["p"], values["omega"] / math.sqrt(6.0))
    oscillator = oscillator_of(values)
    deflection, clearance = oscillator.force / (rate * rate), abs(oscillator.clearance)
    near = clearance < 10.0 * deflection or not deflection
    return (max(deflection, clearance) if near else deflection) or 1.0, rate


@dataclass(frozen=True)
class View:
    """What the page shows."""

    name: str  # of the configuration that opened the page
    method: Mapping[str, Any]  # the group of a configuration, like `record`
    record: Mapping[str, Any]
    nomenclature: Nomenclature  # the names, and the units of values and windows
    values: Mapping[str, float]  # the point of the mark, through which the windows pass
    axis: str  # the abscissa
    across: str  # the ordinate of the map
    xlim: Window  # along `axis`
    maplim: Window  # along `across`
    x0lim: Window  # of the starts
    v0lim: Window
    ordinate: str = "poincare_x"  # one of ``COORDINATES``
    ylim: Window | None = None  # the ordinate window of the diagram; None to fit all points
    marked: bool = False  # whether the motion at `values` is shown
    exact: bool = False  # whether the exact branches are
    tab: int = DIAGRAM_TAB  # ``DIAGRAM_TAB``, ``MAP_TAB`` or ``BASINS_TAB``
    log: tuple[str, ...] = ()  # the parameters whose axes are logarithmic

    @classmethod
    def of(cls, config: SweepConfig) -> Self:
        """Return the view of a configuration: its longest axes, other axes at their first value."""
        axes, nomenclature = config.parameters(), config.nomenclature
        values = {name: float(nomenclature.value(name, axes[name].first)) for name in PARAMETERS}
        axis, across = sorted(axes, key=lambda name: -axes[name].size)[:2]
        axis = axis if axes[axis].size > 1 else "omega"
        across = across if axes[across].size > 1 else "R" if axis != "R" else "omega"
        starts = {axis, across} == {"x0", "v0"}

        def window(name: str) -> Window:
            """Return the range of an axis, or a default window for a fixed parameter."""
            limits = axes[name].low, axes[name].high
            low, high = (float(nomenclature.value(name, limit)) for limit in limits)
            return (low, high) if low < high else window_around(name, values, nomenclature)

        record = config.record.model_dump(include=set(RECORD_FIELDS))
        if record["transient"] == "auto":  # what is found for each point has no field
            record["transient"] = RecordConfig.model_fields["transient"].default
        method = config.method.model_dump()
        if config.method.impact == "exact":  # its steps follow from the parameters
            del method["steps_per_period"]
        return cls(
            name=config.name,
            method=method,
            record=record,
            nomenclature=nomenclature,
            values=values,
            axis=axis,
            across=across,
            xlim=window(axis),
            maplim=window(across),
            x0lim=window("x0"),
            v0lim=window("v0"),
            tab=BASINS_TAB if starts else DIAGRAM_TAB,
            log=tuple(name for name in axes if axes[name].spacing == "log"),
        )

    @property
    def shows_motion(self) -> bool:
        """Whether the open tab shows a motion."""
        return self.marked and self.tab != MAP_TAB

    def moved(self, **values: float) -> Self:
        """Return this view at other values of parameters; the starts stay in front of the stop."""
        beyond = max(0.0, self.x0lim[1] - values.get("clearance", math.inf))
        x0lim = self.x0lim[0] - beyond, self.x0lim[1] - beyond
        return replace(self, values={**self.values, **values}, x0lim=x0lim)

    def with_axis(self, name: str) -> Self:
        """Return this view over another abscissa; the two axes of the map may change places."""
        if name == self.across:
            view = replace(self, xlim=self.maplim, across=self.axis, maplim=self.xlim)
        else:
            view = replace(self, xlim=self.around(name, (self.across, self.maplim)))
        return replace(view, axis=name, ylim=None)

    def with_across(self, name: str) -> Self:
        """Return this view with another ordinate of the map."""
        if name == self.axis:
            return self.with_axis(self.across)
        return replace(self, across=name, maplim=self.around(name, (self.axis, self.xlim)))

    def around(self, name: str, other: tuple[str, Window]) -> Window:
        """Return a default window of a parameter, given the other axis of the map."""
        if name in self.log:
            middle = self.values[name] if self.values[name] > 0.0 else 1.0
            return 0.1 * middle, min(10.0 * middle, PARAMETERS[name].high)
        axis, (low, high) = other  # every start must be in front of every stop
        limits = {"x0": {"x0": high}, "clearance": {"clearance": low}}.get(axis, {})
        return window_around(name, {**self.values, **limits}, self.nomenclature)

    def diagram(self, columns: int, diagnostics: tuple[str, ...] = ()) -> SweepConfig:
        """Return the sweep of the diagram with `columns` values of the axis."""
        return self._sweep({self.axis: (self.xlim, columns)}, diagnostics)

    def plane(self, tab: int) -> tuple[tuple[str, Window], tuple[str, Window]]:
        """Return abscissa and ordinate of the map or of the basins, each with its window."""
        if tab == BASINS_TAB:
            return ("x0", self.x0lim), ("v0", self.v0lim)
        return (self.axis, self.xlim), (self.across, self.maplim)

    def tiles(self, tab: int, columns: int, rows: int) -> SweepConfig:
        """Return the sweep of the map or of the basins with `columns` x `rows` points."""
        (x, x_window), (y, y_window) = self.plane(tab)
        return self._sweep({x: (x_window, columns), y: (y_window, rows)}, self._diagnostics)

    def point(self) -> SweepConfig:
        """Return the sweep of the marked point alone."""
        return self._sweep({}, self._diagnostics)

    @property
    def _diagnostics(self) -> tuple[str, ...]:
        return ("period", "lyapunov") if self.method["impact"] == "exact" else ("period",)

    def _sweep(
        self, axes: Mapping[str, tuple[Window, int]], diagnostics: tuple[str, ...]
    ) -> SweepConfig:
        """Return the sweep over windows, each with its number of values; the rest is fixed."""
        entries: dict[str, Any] = dict(self.values)
        for axis, ((low, high), num) in axes.items():
            entries[axis] = {"start": low, "stop": high, "num": num}
            if axis in self.log:
                entries[axis]["spacing"] = "log"
        group = {
            self.nomenclature.name(key): entries.pop(key) for key in OscillatorConfig.model_fields
        }
        if self.nomenclature.rig is not None:
            group = {"mass": self.nomenclature.rig.mass, **group}
        data = {
            "name": self.name,
            self.nomenclature.group: group,
            "start": entries,
            "method": dict(self.method),
            "record": {**self.record, "diagnostics": diagnostics},
            "units": dict(self.nomenclature.units),
        }
        return load_config(data)

    def query(self) -> str:
        """Return the view as the query of an address."""
        items: dict[str, Any] = {
            self.nomenclature.name(name): repr(value) for name, value in self.values.items()
        }
        items |= {called: self.record[name] for name, called in RECORD_FIELDS.items()}
        items |= {name: self.nomenclature.name(getattr(self, name)) for name in _CHOSEN}
        items |= {name: int(getattr(self, name)) for name in ("tab", *_FLAGS)}
        for name in _WINDOWS:
            if (window := getattr(self, name)) is not None:
                items[name] = f"{window[0]!r}:{window[1]!r}"
        return urlencode(items, safe=":")

    def with_query(self, query: str) -> Self:
        """Return the view that an address describes, not checked; what it lacks stays."""
        entries = dict(parse_qsl(query.removeprefix("?"), keep_blank_values=True))
        named = {self.nomenclature.name(name): name for name in PARAMETERS}
        changes: dict[str, Any] = {
            name: named.get(entries[name], entries[name]) for name in _CHOSEN if name in entries
        }
        changes["record"] = {
            **self.record, **{n: entries[c] for n, c in RECORD_FIELDS.items() if c in entries}
        }  # fmt: skip
        numbers = {
            parameter: _typed_number(name, entries[name], self.nomenclature.about(parameter))
            for name, parameter in named.items()
            if name in entries
        }
        try:
            changes |= {name: bool(int(entries[name])) for name in _FLAGS if name in entries}
            changes |= {"tab": int(entries["tab"]) % 3} if "tab" in entries else {}
            for name in _WINDOWS:
                if name in entries:
                    low, high = map(float, entries[name].split(":"))
                    changes[name] = low, high
        except ValueError as error:
            raise ConfigError(f"the address cannot be read: {error}") from None
        return replace(self.moved(**numbers), **changes)

    def checked(self) -> Self:
        """Return the view, with numbers for texts; ConfigError if it is not allowed."""
        called = self.nomenclature.name
        parameters = one_of([*map(called, PARAMETERS)])
        for key in ("axis", "across"):
            parameters.checked(key, called(getattr(self, key)), ConfigError)
        one_of(COORDINATES).checked("ordinate", self.ordinate, ConfigError)
        if self.axis == self.across:
            raise ConfigError(f"{called(self.axis)} is asked for as both axes of the map")
        if self.record["transient"] == "auto":
            raise ConfigError("transient = auto is not for the live page; expected: an integer")
        for name in _WINDOWS:
            low, high = window = getattr(self, name) or (0.0, 1.0)
            least = _LEAST_WINDOW * max(abs(low), abs(high))
            if not (math.isfinite(low + high) and high - low > least):
                raise ConfigError(f"the window {name} = {window} is empty or too narrow")
        for name, value in self.values.items():
            if not (parameter := self.nomenclature.about(name)).accepts(value):
                raise ConfigError(refusal(f"{called(name)} = {value:g}", parameter.allowed))
            if abs(value) > LARGEST:
                raise ConfigError(refusal(f"{called(name)} = {value:g}", f"up to {LARGEST:g}"))
        self.point()
        if self.tab != DIAGRAM_TAB:
            self.tiles(self.tab, 2, 2)
        record = self.diagram(2).record
        return replace(self, record={name: getattr(record, name) for name in RECORD_FIELDS})


def _typed_number(name: str, text: str, parameter: Parameter) -> float:
    """Return the value of a parameter from the text of a field or of an address."""
    try:
        return as_number(text)
    except ValueError as error:
        raise ConfigError(f"{name} = {text} {error}; expected: {parameter.allowed}") from None


def window_bounds(
    name: str, view: View, window: Window
) -> tuple[float | None, float | None] | None:
    """Return the limits of a window that is shown; None where there is no limit."""
    parameter = PARAMETERS[name]
    low = parameter.low
    if parameter.low_open:
        _, rate = _scales(_model_values(view.values, view.nomenclature))
        low = min(float(view.nomenclature.value(name, 1e-3 * rate)), window[0])
    low = view.values["x0"] if name == "clearance" else low
    high = view.values["clearance"] if name == "x0" else parameter.high
    limits = (low if math.isfinite(low) else None, high if math.isfinite(high) else None)
    return None if limits == (None, None) else limits


def write_yaml(view: View, config: SweepConfig, folder: Path) -> Path:
    """Write the configuration of the picture in the open tab to a new file in a folder."""
    names = (f"{view.name}-view-{number}" for number in itertools.count(1))
    name = next(name for name in names if not os.path.lexists(folder / f"{name}.yaml"))
    path = folder / f"{name}.yaml"
    text = _commands(view, name) + config.model_copy(update={"name": name}).to_yaml()
    with writing(path, "configuration", only_new=True) as new:
        new.write(text.encode())
    return path


def _commands(view: View, name: str) -> str:
    """Return a comment with the commands that draw the picture."""
    options = f"--kind {('bifurcation', 'map', 'basins')[view.tab]}"
    if view.tab == DIAGRAM_TAB:
        limits = {"xlim": (view.xlim, view.axis), "ylim": (view.ylim, view.ordinate)}
        options += f" --coordinate {view.ordinate}" + " --exact" * view.exact
        for option, (ends, quantity) in limits.items():
            if ends is not None:
                unit = as_variable(quantity, view.nomenclature).attrs["units"]
                unit = unit if unit in ("m", "m/s") else ""  # the ticks may have a prefix
                options += f" --{option}={ends[0]!r}:{ends[1]!r}{unit}"
    run, plot = command("run", Path(f"{name}.yaml")), command("plot", Path(f"{name}.h5"))
    return f"# Saved by vibroimpact explore. These draw it:\n#   {run}\n#   {plot} {options}\n"
