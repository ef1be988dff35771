"""Exact branches and curves that are kept in the cache of this user: packed, and read again."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sweeps.opened.cuts import Selection
from vibroimpact.jit import NUMERICS, numerics_of
from vibroimpact.jit.cache import read, root, write

#: The array that describes a result, as JSON.
_ABOUT = "about"
#: Most results that are kept; the oldest go first.
_MOST = 100
#: The rooms whose code decides, besides the physics, what is found.
_ROOMS = ("bifurcation", "opened")


def with_cache(
    find: Callable[..., xr.Dataset], say: Callable[[str], object]
) -> Callable[..., xr.Dataset]:
    """Return `branches` or `curves` as a function that keeps what it finds, and uses it again.

    What was found is used again if the data of the opened file, the code of the physics, of
    ``bifurcation`` and of ``opened``, and the request are the same. `say` is told that, or why what
    was found is not kept.
    """

    def found(
        dataset: xr.Dataset,
        axes: str | Sequence[str],
        at: Selection | None = None,
        *checks: Callable[..., object],
        **chosen: Any,
    ) -> xr.Dataset:
        """Look for a kept result first."""
        data = dataset.encoding.get("digest", "")
        code = [numerics_of(Path(__file__).parents[1] / room) for room in _ROOMS]
        request = [find.__name__, axes, sorted((at or {}).items()), sorted(chosen.items())]
        key = json.dumps([data, NUMERICS, code, request], default=int)
        path = root() / "exact" / hashlib.sha256(key.encode()).hexdigest()[:24]
        if data and (before := _read(path)) is not None:
            say("the exact orbits were found before, and are used again")
            return before
        result = find(dataset, axes, at, *checks, **chosen)
        if not data:
            say("the exact orbits are not kept: the sweep is not complete")
            return result
        try:
            write(path, _packed(result), _MOST)
        except OSError as error:
            say(f"the exact orbits are not kept in {path.parent}: {error.strerror or error}")
        return result

    return found


def _packed(found: xr.Dataset) -> bytes:
    """Return an archive of the variables of a Dataset and their description."""
    about = {
        "coords": [str(name) for name in found.coords],
        "dims": {str(name): list(map(str, found[name].dims)) for name in found.variables},
        "of": {str(name): found[name].attrs for name in found.variables},
        "attrs": found.attrs,
    }
    arrays: dict[str, Any] = {str(name): found[name].values for name in found.variables}
    image = io.BytesIO()
    np.savez(image, **{_ABOUT: np.array(json.dumps(about)), **arrays})
    return image.getvalue()


def _read(path: Path) -> xr.Dataset | None:
    """Return the Dataset that was kept in a file; None without one."""
    with suppress(Exception):  # other contents raise errors of a dozen kinds
        with np.load(io.BytesIO(read(path) or b"")) as arrays:
            about = json.loads(str(arrays[_ABOUT]))
            variables = {
                name: (dims, arrays[name], about["of"][name])
                for name, dims in about["dims"].items()
            }
        return xr.Dataset(variables, attrs=about["attrs"]).set_coords(about["coords"])
    return None
