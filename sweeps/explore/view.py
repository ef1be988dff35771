"""What is looked at: a point in the space of the parameters, and the windows around it.

A `View` is a plain value. It gives the configuration of every picture, which is all that determines
the numbers, and the text that stands in the address of the page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self
from urllib.parse import parse_qsl, urlencode

from sweeps.config.loading import load_config
from sweeps.config.schema import OscillatorConfig
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import extremes, length
from sweeps.messages import ConfigError
from sweeps.plotting.lines import COORDINATES
from vibroimpact.oscillator import PARAMETERS

Window = tuple[float, float]

#: The tabs of the page.
DIAGRAM, MAP, BASINS = range(3)
_RECORD = ("transient", "periods", "phase", "impacts")
_WINDOWS = ("xlim", "ylim", "maplim", "x0lim", "v0lim")
_NAMES = ("axis", "ordinate", "across")
_FLAGS = ("marked", "exact")


def window_around(name: str, value: float) -> Window:
    """Return values of a parameter to look at, `value` among them."""
    low, high = 0.5 * value, 2.0 * value
    if PARAMETERS[name].low == 0.0:
        low, high = (low, high) if name in ("omega", "p") else (0.0, max(0.5, high))
        return low, min(high, PARAMETERS[name].high)
    return value - max(2.0, abs(value)), value + max(2.0, abs(value))


@dataclass(frozen=True)
class View:
    """What the page shows.

    Attributes
    ----------
    name : str
        Of the configuration that it was opened with.
    method, record : mapping
        Those of a configuration.
    values : mapping of str to float
        The point in the space of all parameters: where the windows cut, and where the mark is.
    axis, across : str
        The abscissa, and the ordinate of the map.
    xlim, maplim, x0lim, v0lim : (float, float)
        The windows along these and over the starts.
    ordinate : str
        One of ``COORDINATES``.
    ylim : (float, float) or None
        Of the diagram; None where it is to hold all points.
    marked, exact : bool
        Whether the motion at `values`, and the exact branches, are shown.
    tab : int
        ``DIAGRAM``, ``MAP`` or ``BASINS``.
    """

    name: str
    method: Mapping[str, Any]
    record: Mapping[str, Any]
    values: Mapping[str, float]
    axis: str
    across: str
    xlim: Window
    maplim: Window
    x0lim: Window
    v0lim: Window = (-2.0, 2.0)
    ordinate: str = COORDINATES[0]
    ylim: Window | None = None
    marked: bool = False
    exact: bool = False
    tab: int = DIAGRAM

    @classmethod
    def of(cls, config: SweepConfig) -> Self:
        """Return the view of a configuration: its longest axis, the others at their first value."""
        entries = {**dict(config.oscillator.items()), **dict(config.start.items())}
        first = {name: extremes(value)[0] for name, value in entries.items()}
        values = {name: first[name] for name in PARAMETERS}
        sizes = {name: length(value) for name, value in entries.items()}
        axis, across = sorted(sizes, key=lambda name: -sizes[name])[:2]
        axis = axis if sizes[axis] > 1 else "omega"
        across = across if sizes[across] > 1 else "R" if axis != "R" else "omega"

        def window(name: str) -> Window:
            ends = extremes(entries[name])
            low, high = min(ends), max(ends)
            return (low, high) if low < high else window_around(name, low)

        method: dict[str, Any] = {
            "integrator": config.method.integrator,
            "impact": config.method.impact,
        }
        if config.method.impact != "exact":  # whose steps follow from the parameters
            method["steps_per_period"] = config.steps
            method["allow_unstable"] = config.method.allow_unstable
        record = {name: getattr(config.record, name) for name in _RECORD}
        starts = {name: window(name) for name in ("x0", "v0")}
        if sizes["x0"] == 1:
            starts["x0"] = values["clearance"] - 3.0, values["clearance"]
        return cls(
            config.name,
            method,
            record,
            values,
            axis,
            across,
            window(axis),
            window(across),
            starts["x0"],
            starts["v0"],
        )

    def moved(self, **values: float) -> Self:
        """Return this view at other values of some parameters; the starts stay before the stop."""
        beyond = max(0.0, self.x0lim[1] - values.get("clearance", math.inf))
        x0lim = self.x0lim[0] - beyond, self.x0lim[1] - beyond
        return replace(self, values={**self.values, **values}, x0lim=x0lim)

    def diagram(self, columns: int) -> SweepConfig:
        """Return the sweep of the diagram, with so many values of the axis."""
        return self._sweep({self.axis: (self.xlim, columns)}, ())

    def map(self, columns: int, rows: int) -> SweepConfig:
        """Return the sweep of the map of classes."""
        axes = {self.across: (self.maplim, rows), self.axis: (self.xlim, columns)}
        return self._sweep(axes, self._diagnostics)

    def basins(self, columns: int, rows: int) -> SweepConfig:
        """Return the sweep over the starts."""
        axes = {"x0": (self.x0lim, columns), "v0": (self.v0lim, rows)}
        return self._sweep(axes, self._diagnostics)

    def map_axes(self) -> tuple[str, str]:
        """Return abscissa and ordinate of the map."""
        return self.axis, self.across

    def map_windows(self) -> tuple[Window, Window]:
        """Return their windows."""
        return self.xlim, self.maplim

    def start_axes(self) -> tuple[str, str]:
        """Return abscissa and ordinate of the basins."""
        return "x0", "v0"

    def start_windows(self) -> tuple[Window, Window]:
        """Return their windows."""
        return self.x0lim, self.v0lim

    def point(self) -> SweepConfig:
        """Return the sweep of the marked point alone."""
        return self._sweep({}, self._diagnostics)

    @property
    def _diagnostics(self) -> tuple[str, ...]:
        return ("period", "lyapunov") if self.method["impact"] == "exact" else ("period",)

    def _sweep(
        self,
        axes: Mapping[str, tuple[Window, int]],
        diagnostics: tuple[str, ...],
    ) -> SweepConfig:
        entries: dict[str, Any] = dict(self.values)
        for axis, ((low, high), num) in axes.items():
            entries[axis] = {"start": low, "stop": high, "num": num}
        oscillator = {key: entries.pop(key) for key in OscillatorConfig.model_fields}
        data = {
            "name": self.name,
            "oscillator": oscillator,
            "start": entries,
            "method": dict(self.method),
            "record": {**self.record, "diagnostics": diagnostics},
        }
        return load_config(data)

    def query(self) -> str:
        """Return the view as the query of an address."""
        items: dict[str, Any] = {name: repr(value) for name, value in self.values.items()}
        items |= {name: self.record[name] for name in _RECORD}
        items |= {name: getattr(self, name) for name in _NAMES}
        items |= {name: int(getattr(self, name)) for name in ("tab", *_FLAGS)}
        for name in _WINDOWS:
            if (window := getattr(self, name)) is not None:
                items[name] = f"{window[0]!r}:{window[1]!r}"
        return urlencode(items, safe=":")

    def with_query(self, query: str) -> Self:
        """Return the view that an address describes; what it leaves out stays.

        Raises
        ------
        ConfigError
            If it asks for what is not allowed.
        """
        entries = dict(parse_qsl(query.removeprefix("?")))
        changes: dict[str, Any] = {name: entries[name] for name in _NAMES if name in entries}
        changes["record"] = {**self.record, **{n: entries[n] for n in _RECORD if n in entries}}
        try:
            numbers = {name: float(entries[name]) for name in PARAMETERS if name in entries}
            changes |= {name: bool(int(entries[name])) for name in _FLAGS if name in entries}
            changes |= {"tab": int(entries["tab"]) % 3} if "tab" in entries else {}
            for name in _WINDOWS:
                if name in entries:
                    low, high = map(float, entries[name].split(":"))
                    changes[name] = low, high
        except ValueError as error:
            raise ConfigError(f"the address cannot be read: {error}") from None
        view = replace(self.moved(**numbers), **changes)
        view.check()
        record = view.diagram(2).record  # whose texts are numbers now
        return replace(view, record={name: getattr(record, name) for name in _RECORD})

    def check(self) -> None:
        """Refuse what cannot be computed.

        Raises
        ------
        ConfigError
        """
        for name, allowed in (("axis", PARAMETERS), ("across", PARAMETERS)):
            if getattr(self, name) not in allowed:
                raise ConfigError(f"{getattr(self, name)} is no parameter: {', '.join(allowed)}")
        if self.ordinate not in COORDINATES:
            raise ConfigError(f"{self.ordinate} is no ordinate: {', '.join(COORDINATES)}")
        if self.axis == self.across:
            raise ConfigError(f"{self.axis} is entries for both axes of the map")
        for name in _WINDOWS:
            window = getattr(self, name)
            if window is not None and not (math.isfinite(sum(window)) and window[0] < window[1]):
                raise ConfigError(f"the window {name} = {window} is empty")
        self.point()
        self.diagram(2)
        if self.tab == MAP:
            self.map(2, 2)
        if self.tab == BASINS:
            self.basins(2, 2)


def bounds(name: str, values: Mapping[str, float]) -> tuple[float | None, float | None] | None:
    """Return the least and the greatest value that a window may hold; None for no limit."""
    parameter = PARAMETERS[name]
    low = 1e-3 if parameter.low_open else parameter.low
    low = values["x0"] if name == "clearance" else low
    high = values["clearance"] if name == "x0" else parameter.high
    ends = (low if math.isfinite(low) else None, high if math.isfinite(high) else None)
    return None if ends == (None, None) else ends
