"""The words beside an axis: the meaning, the symbol and the unit of a quantity."""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from sweeps.analysis.coordinates import COORDINATES
from sweeps.store import VARIABLES
from sweeps.text import in_units
from vibroimpact.oscillator import PARAMETERS, Parameter


def as_variable(name: str, units: Mapping[str, str] | None = None) -> xr.DataArray:
    """Return a parameter, a variable that a file may not have, or a coordinate, without values."""
    about = PARAMETERS[name] if name in PARAMETERS else {**VARIABLES, **COORDINATES}[name]
    meaning = about.meaning if isinstance(about, Parameter) else about.long_name
    unit = in_units(about.unit, units or {})
    return xr.DataArray(attrs={"long_name": meaning, "units": unit, "symbol": about.symbol})


def label(variable: xr.DataArray, gap: str = " ") -> str:
    """Write the meaning of a variable and, after `gap`, its symbol and unit."""
    units = variable.attrs["units"]
    unit = "" if units == "1" else f" [{units.replace('^2', '$^2$')}]"
    return f"{variable.attrs['long_name']}{gap}${variable.attrs['symbol']}${unit}"
