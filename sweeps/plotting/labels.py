"""Writes labels and titles: names, symbols, units, prefixes, methods; sets scales and ticks."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib import ticker

from sweeps.config.rig import Nomenclature
from sweeps.errors import Refused
from sweeps.opened.coordinates import ORDINATES
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.store.variables import VARIABLES
from sweeps.text import in_brackets, near_misses, shown_count, suggestion, unit_name
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    from vibroimpact.points.stages import RunSpec

#: What has the names and units that a reader sees.
Names = OpenedSweep | Nomenclature
#: Greatest number in a picture: beyond it matplotlib overflows as it looks for ticks.
LARGEST = 4e307
#: Title of a legend of periodic classes.
CLASSES_TITLE = "m/q: q impacts in m forcing periods"
#: Units that take a prefix in pictures, and for each prefix the least size of what it is put to,
#: a thousandth of the greatest, and its factor.
_PREFIXED = ("m", "m/s")
_MICRO, _MU = "\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"
_PREFIXES = ((1e-4, "m", 1e-3), (1e-7, _MICRO, 1e-6), (1e-10, "n", 1e-9))
#: A space at which a title is not broken into lines.
_JOINT = "\N{NO-BREAK SPACE}"


def as_variable(name: str, source: Names) -> xr.DataArray:
    """Return the attributes of a variable, or a parameter as a reader sees it, as a DataArray."""
    nomenclature = source if isinstance(source, Nomenclature) else source.nomenclature
    about = nomenclature.about(name) if name in PARAMETERS else {**VARIABLES, **ORDINATES}[name]
    units = nomenclature.unit(about.unit)
    return xr.DataArray(attrs={"long_name": about.meaning, "units": units, "symbol": about.symbol})


def label(variable: xr.DataArray, prefix: str = "") -> str:
    """Write the meaning of a variable, its symbol and, if the unit has a name, its unit."""
    # Spaces occur only between words, because matplotlib breaks long labels at spaces.
    unit = (named := named_unit(variable)) and prefix + named.replace(" ", _JOINT)
    symbol = variable.attrs["symbol"].replace(r"\ ", "~").replace(" ", "\t")
    return variable.attrs["long_name"] + (f" ${symbol}$" if symbol else "") + in_brackets(unit)


def named_unit(variable: xr.DataArray) -> str:
    """Return the unit of a variable if a name was chosen for it, else an empty text."""
    unit = variable.attrs.get("units", "1")  # a user's own coordinate has no unit
    return unit_name(unit).replace("^2", "$^2$")


def basins_title(sweep: OpenedSweep) -> str:
    """Write the title of a legend of basins."""
    unit = in_brackets(named_unit(as_variable("impact_v", sweep)))
    return f"{CLASSES_TITLE},\nspeed before each impact{unit}; share of the starts"


def mathtext(value: float, form: str = ".6g") -> str:
    """Write a number in mathtext, which would read 1e+300 as a product."""
    mantissa, e, exponent = f"{value:{form}}".partition("e")
    return rf"{mantissa}\times10^{{{int(exponent)}}}" if e else mantissa


def prefix_of(variable: xr.DataArray, size: float, text: str | None = None) -> tuple[str, float]:
    """Return the prefix for a size, or that of the unit in brackets in a text, and its factor."""
    base = variable.attrs.get("units")
    if base in _PREFIXED:
        for unit in re.findall(r"[\[(]\s*([^\s\])]+)\s*[\])]", _plain(text or "")):
            if unit in units_of(variable):
                return unit.removesuffix(base), units_of(variable)[unit]
        for least, prefix, factor in _PREFIXES:
            if least <= abs(size) < 1000.0 * least:
                return prefix, factor
    return "", 1.0


def _plain(text: str) -> str:
    """Return a label with its units as they are known, without mathtext."""
    return text.replace(r"\mu", _MICRO).replace(_MU, _MICRO).replace("$", "").replace("²", "^2")


def units_of(variable: xr.DataArray) -> dict[str, float]:
    """Return the units in which a variable can be given, its own first, in its own unit."""
    base = variable.attrs.get("units", "")
    units = {base: 1.0} if base in ("1", "rad") or unit_name(base) else {}
    if base in _PREFIXED:
        units |= {prefix + base: factor for _, prefix, factor in _PREFIXES} | {f"u{base}": 1e-6}
    return units


def with_unit(variable: xr.DataArray, value: float) -> tuple[float, str]:
    """Return a value and its unit, with a prefix; the unit is empty if it has no name."""
    prefix, factor = prefix_of(variable, value)
    named = named_unit(variable)
    return value / factor, named and prefix + named


def equation(symbol: str, variable: xr.DataArray, value: float) -> str:
    """Write a symbol with its value and, if the unit of the variable has a name, its unit."""
    number, unit = with_unit(variable, value)
    return _JOINT.join([f"${symbol}={mathtext(number)}$", *unit.split()])


def status_name(outcome: Status) -> str:
    """Return the name of an outcome for a legend."""
    return outcome.meaning if outcome is Status.PENDING else outcome.word


def record_text(line: OpenedSweep, coordinate: str = "") -> str:
    """Write a phase that is not 0, the transient and the periods, and what is left out of these."""
    spec = line.spec
    transient = "auto" if spec.longest is not None else f"{spec.transient:,}"
    parts = [f"phase {spec.phase:.6g} rad"] if spec.phase else []
    parts += [f"transient {transient}", f"record {shown_count(spec.periods, 'period')}"]
    if coordinate and (dimension := ORDINATES[coordinate].dimension) in ("section", "impact"):
        parts += filter(None, [line.left_out(dimension)])
    return ", ".join(part.replace(" ", _JOINT) for part in parts)


def method_text(spec: RunSpec) -> list[str]:
    """Write integrator, impact rule and steps per period, unless both are exact."""
    if spec.integrator == spec.impact == "exact":
        return []
    steps = f"{spec.steps_per_period:,}{_JOINT}steps{_JOINT}per{_JOINT}period"
    return [spec.integrator, f"impact{_JOINT}rule{_JOINT}{spec.impact}", steps]


def title(cut: OpenedSweep, record: str | None = None) -> str:
    """Write the title of a picture: name, parameters that are not the defaults, record, method."""
    spec, nomenclature = cut.spec, cut.nomenclature
    usual = {name: parameter.default for name, parameter in nomenclature.parameters.items()}
    if "a" in cut and bool((cut["a"] > 0.0).any()):
        usual[nomenclature.name("f")] = 0.0  # the base alone may shake the mass
    items = [
        equation(parameter.symbol, cut[name], float(cut[name]))
        for name, parameter in nomenclature.parameters.items()
        if not cut[name].dims and float(cut[name]) != usual[name]
    ]
    if spec.followed is not None and len(cut.directions) < 2:  # else it is in the legend
        items.append(followed(cut))
    items.append(record_text(cut) if record is None else record)
    items += method_text(spec)
    if not cut.grid:
        items += filter(None, [Status(int(cut["status"])).remark(spec.impact)])
    name = cut.config.name.replace("$", r"\$")
    return f"{name}\n{', '.join(items)}"


def followed(cut: OpenedSweep) -> str:
    """Write in which directions, and along which axis, the motions of a picture were followed."""
    directions = " and ".join(cut.followed_directions)
    return f"followed {directions} along ${cut.followed_symbol}$"


def direction_names(sweep: OpenedSweep) -> tuple[str, str]:
    """Return the names of the two directions for a legend, with the symbol of the followed axis."""
    symbol = sweep.followed_symbol
    return rf"up, ${symbol} \rightarrow$", rf"down, ${symbol} \leftarrow$"


def log_spaced(values: np.ndarray) -> bool:
    """Whether neighbouring values have a constant ratio, and a range wide enough for a log axis."""
    if len(values) < 3 or values.min() <= 0.0 or values.max() < 5.0 * values.min():
        return False
    ratios = values[1:] / values[:-1]
    return np.allclose(ratios, ratios[0], rtol=1e-6)


class _Prefixed(ticker.Formatter):
    """Writes ticks and the label with the prefix that fits the limits; `plain` writes numbers."""

    def __init__(
        self, axis: Axis, variable: xr.DataArray, plain: ticker.Formatter, text: Text
    ) -> None:
        self._axis, self.variable, self._plain, self._text = axis, variable, plain, text
        self._prefix, self._factor = "", 1.0
        self._fixed: tuple[str, float] | None = None
        plain.axis = None
        plain.create_dummy_axis()

    def keep(self, unit: str, text: str | None) -> float:
        """Keep a unit for the ticks, by default of a label or of the limits; return its factor."""
        size = np.abs(self._axis.get_view_interval()).max()
        label_text = f"[{unit.replace('u', _MICRO)}]" if unit else text
        self._fixed = prefix_of(self.variable, size, label_text)
        return self._fixed[1]

    def set_locs(self, locs: Any) -> None:
        """Choose the prefix for the limits of the axis."""
        limits = np.array(self._axis.get_view_interval())
        text, old = self._text.get_text(), label(self.variable, self._prefix)
        custom = None if text == old else text
        chosen = prefix_of(self.variable, np.abs(limits).max(), custom)
        self._prefix, self._factor = self._fixed or chosen
        if custom is None:
            self._text.set_text(label(self.variable, self._prefix))
        assert self._plain.axis is not None
        self._plain.axis.set_view_interval(*limits / self._factor)
        self._plain.set_locs((np.asarray(locs) / self._factor).tolist())

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Write a tick."""
        return self._plain(x / self._factor, pos)

    def get_offset(self) -> str:
        """Return the common part of all ticks."""
        return self._plain.get_offset()


def in_own_unit(
    axis: Axis, name: str, limits: tuple[float, float], unit: str, text: str | None
) -> tuple[float, float]:
    """Return limits in the unit of the variable; given in a unit, by default that of the ticks."""
    if unit:
        check_units(axis, f"{name} = {limits[0]:g}:{limits[1]:g}", f"[{unit}]", False)
    formatter = axis.get_major_formatter()
    factor = formatter.keep(unit, text) if isinstance(formatter, _Prefixed) else 1.0
    return limits[0] * factor, limits[1] * factor


def check_units(axis: Axis, typed: str, text: str, allow_unnamed: bool) -> None:
    """Refuse a text with a unit in brackets that is not one of the ticks, if these have one."""
    formatter = axis.get_major_formatter()
    known = [*units_of(formatter.variable)] if isinstance(formatter, _Prefixed) else []
    for unit in re.findall(r"\[\s*(.*?)\s*\]", _plain(text)):
        if unit not in known and (known or not allow_unnamed):
            allowed = f"{' or '.join(known) or 'no unit'}{suggestion(near_misses(unit, known))}"
            raise Refused(f"{typed} in {unit} is not allowed; expected: {allowed}")


def label_axis(axis: Axis, variable: xr.DataArray, heading: bool = False) -> Text:
    """Label the axis of a variable, and return the label; make it logarithmic if the values are."""
    if variable.name in variable.coords:  # a parameter; those that are not drawn may be any
        refuse_too_large(str(variable.name), variable.values)
    text = axis.axes.set_title("", loc="left") if heading else axis.label
    logarithmic = variable.dims == (variable.name,) and log_spaced(variable.values)
    if logarithmic:
        axis.axes.set(**{"xscale" if axis is axis.axes.xaxis else "yscale": "log"})
        tick_in_decades(axis)
    formatter = ticker.StrMethodFormatter("{x:g}") if logarithmic else ticker.ScalarFormatter()
    describe(axis, variable, text, formatter)
    return text


def describe(axis: Axis, variable: xr.DataArray, text: Text, formatter: ticker.Formatter) -> None:
    """Describe a variable beside its axis; ticks with a named unit have a prefix."""
    text.set(text=label(variable), wrap=True)
    if named_unit(variable):
        axis.set_major_formatter(_Prefixed(axis, variable, formatter, text))


def set_lim(axis: Axis, low: float, high: float) -> None:
    """Set the least and the greatest value of an axis, which stays inverted if it is."""
    set_limits = axis.axes.set_xlim if axis is axis.axes.xaxis else axis.axes.set_ylim
    set_limits(*((high, low) if axis.get_inverted() else (low, high)))


def refuse_too_large(name: str, values: np.ndarray | float) -> None:
    """Refuse a parameter with values that are too large for a picture."""
    greatest = float(np.abs(values).max())
    if greatest > LARGEST:
        raise Refused(f"{name} reaches {greatest:.3g}; a picture shows up to {LARGEST:g}")


class DecadeLocator(ticker.LogLocator):
    """Ticks at 1, 2, 5, at 1, 3 or at 1 in decades, as there is room, or of a linear axis."""

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        """Return the ticks within limits, as many as `numticks` or the axis has room for."""
        low, high = sorted((vmin, vmax))
        first, last = math.floor(math.log10(low)), math.floor(math.log10(high))
        axis: Any = self.axis
        most = self.numticks
        room = max(2, most if isinstance(most, int) else axis.get_tick_space())
        powers = 10.0 ** np.arange(first, last + 1, dtype=float)
        with np.errstate(over="ignore"):
            choices = [np.outer(powers, parts).ravel() for parts in ((1, 2, 5), (1, 3), (1,))]
        many, some, few = (each[(low <= each) & (each <= high)] for each in choices)
        if len(many) < 2:
            steps = ticker.MaxNLocator(min(room, 9), steps=[1, 2, 2.5, 5, 10])
            return np.asarray(steps.tick_values(low, high)).tolist()
        few = few[:: max(1, math.ceil(len(few) / room))]
        if len(few) < 2:  # there are never less than two
            few = (some if len(some) > 1 else many)[[0, -1]]
        return next((each for each in (many, some) if 1 < len(each) <= room), few).tolist()


def tick_in_decades(axis: Axis) -> None:
    """Label 1, 2 and 5 in every decade with plain numbers, as far as these have room."""
    axis.set_major_locator(DecadeLocator())
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(ticker.NullFormatter())
