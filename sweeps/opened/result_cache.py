"""`with_cache` keeps exact orbits, crises and least knocks on disk, by a digest of the request."""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sweeps.opened.doors import takes_sweep
from sweeps.opened.opened_sweep import OpenedSweep
from vibroimpact.jit import NUMERICS, numerics_of
from vibroimpact.jit.cache import read, root, write
from vibroimpact.status import Status

#: Most results that are kept; the oldest go first.
_MOST = 100
#: The rooms whose code decides, besides the physics, what is found.
_ROOMS = ("attractor", "bifurcation", "config", "opened")


def with_cache(
    find: Callable[..., xr.Dataset], say: Callable[[str], object] = lambda text: None
) -> Callable[..., xr.Dataset]:
    """Return `branches` or another function of a sweep as one that keeps and reuses what it finds.

    A result is used again if the motions of the sweep, the code that decides and the request are
    the same. `say` is told that, or why what was found is not kept.
    """

    @takes_sweep({})
    def cached(sweep: OpenedSweep, *request: Any, **chosen: Any) -> xr.Dataset:
        """Look for a result on disk first."""
        code = [numerics_of(Path(__file__).parents[1] / room) for room in _ROOMS]
        call = [find.__name__, [each for each in request if not callable(each)], chosen]
        about = sweep.config.to_yaml(), sweep.in_rig, sweep.grid
        motions = _digest(about, sweep.data.coords, sweep.recorded_motions)
        key = json.dumps([motions, NUMERICS, code, call], default=_plain, sort_keys=True)
        path = root() / "exact" / hashlib.sha256(key.encode()).hexdigest()[:24]
        if (earlier := _read(path, key)) is not None:
            say("what was found before is used again")
            return earlier
        result = find(sweep, *request, **chosen)
        if (sweep["status"] == Status.PENDING).any():
            say("what was found is not kept: the sweep is not complete")
            return result
        try:
            write(path, pickle.dumps((key, result.to_dict(data="array"))), _MOST)
        except OSError as error:
            say(f"what was found is not kept in {path.parent}: {error.strerror or error}")
        return result

    return cached


def _plain(value: Any) -> int | str:
    """Return what JSON cannot hold of a request: an integer of NumPy, or a digest of a Dataset."""
    return _digest("", value.variables, {}) if isinstance(value, xr.Dataset) else int(value)


def _digest(about: object, variables: Mapping[Any, Any], arrays: Mapping[str, np.ndarray]) -> str:
    """Return a digest of variables of xarray and of arrays, and of what else describes them."""
    digest = hashlib.sha256(repr(about).encode())
    by_name = {(name, *variable.dims): variable.values for name, variable in variables.items()}
    for name, values in [*by_name.items(), *arrays.items()]:
        numbers = values.astype(str) if values.dtype == object else values
        digest.update(repr((name, numbers.dtype.str, numbers.shape)).encode() + numbers.tobytes())
    return digest.hexdigest()


def _read(path: Path, key: str) -> xr.Dataset | None:
    """Return the Dataset that was kept in a file for this key; None without one."""
    with suppress(Exception):  # of other contents; `read` trusts a file as it trusts code
        key_of_file, orbits = pickle.loads(read(path) or b"")
        return xr.Dataset.from_dict(orbits) if key_of_file == key else None
    return None
