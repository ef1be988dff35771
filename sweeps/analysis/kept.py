"""Exact branches and curves that are kept beside the file of a sweep, and used again."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.cuts import Selection
from sweeps.errors import Failed, StoreError
from sweeps.store.kept import is_damaged, keep, kept_path, read_kept
from vibroimpact.jit import NUMERICS, numerics_of

#: The array that describes a result, as JSON.
_ABOUT = "about"


def kept(
    find: Callable[..., xr.Dataset], say: Callable[[str], object]
) -> Callable[..., xr.Dataset]:
    """Return `branches` or `curves` as a function that keeps what it finds, and uses it again.

    What was found is used again if the data of the opened file, the code of the physics and of the
    analysis, and the request are the same. `say` is told that, or why what was found is not kept.
    """

    def found(
        dataset: xr.Dataset,
        axes: str | Sequence[str],
        at: Selection | None = None,
        *checks: Callable[..., object],
        **chosen: Any,
    ) -> xr.Dataset:
        """Look for a kept result first."""
        file = Path(str(dataset.encoding.get("source", "")))
        data = dataset.encoding.get("digest", "")
        if not data:
            result = find(dataset, axes, at, *checks, **chosen)
            say("the exact orbits are not kept: the sweep is not complete")
            return result
        source = f"data {data}, code {NUMERICS} {numerics_of(Path(__file__).parent)}"
        request = [find.__name__, axes, sorted((at or {}).items()), sorted(chosen.items())]
        key = f"{source}, request {json.dumps(request, default=int)}"
        if (arrays := read_kept(file, key)) is not None:
            say(f"the exact orbits are those of {kept_path(file)}")
            return _from_arrays(arrays)
        result = find(dataset, axes, at, *checks, **chosen)
        if is_damaged(file):
            say(f"{kept_path(file)} was damaged, and is replaced")
        try:
            keep(file, key, _as_arrays(result), source)
        except (StoreError, Failed, OSError) as error:
            say(f"the exact orbits are not kept: {error}")
        return result

    return found


def _as_arrays(found: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the variables of a Dataset, and their description."""
    about = {
        "coords": [str(name) for name in found.coords],
        "dims": {str(name): list(map(str, found[name].dims)) for name in found.variables},
        "of": {str(name): found[name].attrs for name in found.variables},
        "attrs": found.attrs,
    }
    arrays = {str(name): found[name].values for name in found.variables}
    return {_ABOUT: np.array(json.dumps(about)), **arrays}


def _from_arrays(arrays: dict[str, np.ndarray]) -> xr.Dataset:
    """Return the Dataset of `_as_arrays`."""
    about = json.loads(str(arrays[_ABOUT]))
    variables = {
        name: (dims, arrays[name], about["of"][name]) for name, dims in about["dims"].items()
    }
    return xr.Dataset(variables, attrs=about["attrs"]).set_coords(about["coords"])
