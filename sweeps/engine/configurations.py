"""The configuration of a sweep, read from a YAML or sweep file, and zoomed to a part of it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from sweeps.config.loading import load_config, stored_config
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.interrupts import raised_at_once
from sweeps.store import columns_of, is_sweep
from sweeps.text import near_miss, suggestion


def read_config(path: Path, overrides: Sequence[str] = ()) -> SweepConfig:
    """Read the configuration of a sweep from a YAML file or from a sweep file.

    The configuration of a sweep file has that file as its output. The overrides are those of
    `sweeps.load_config`.
    """
    if not is_sweep(path):
        if path.suffix == ".h5" and path.is_file():
            raise Refused(
                f"{path} is no file of a sweep; a configuration must not have the ending .h5"
            )
        with raised_at_once():  # reading from a pipe may never end
            return load_config(path, overrides)
    from sweeps.store import open_sweep  # it imports xarray, which is slow

    with open_sweep(path, verify=False) as dataset:
        text, table = dataset.attrs["configuration"], columns_of(dataset) or None
        if "refine" in yaml.safe_load(text):
            warnings.warn(
                f"an earlier version added points to those of the configuration of {path}, which "
                f"has {dataset['status'].size:,}; the added points are not computed again",
                stacklevel=2,
            )
    config = stored_config(text, f"{path}, its configuration", path.stem, table, overrides)
    if any(override.partition("=")[0].strip() == "output" for override in overrides):
        return config
    return config.model_copy(update={"output": path})


def zoomed(config: SweepConfig, pieces: Mapping[str, tuple[float, float]]) -> SweepConfig:
    """Return the same sweep over pieces (low, high) of its axes, with as many points along each.

    A range keeps its linear or logarithmic spacing; a list becomes a linear range. The number of
    steps per period is raised if exact impacts need more steps beyond the ends of the sweep. Raises
    Refused if an axis is not swept, and ConfigError if the sweep is not valid over a piece.
    """
    if config.points is not None:
        raise Refused("the rows of a table have no axis to zoom into")
    data = yaml.safe_load(config.to_yaml())
    seen = config.nomenclature
    axes = {seen.name(own): values for own, values in config.sweep.grid.axes.items()}
    for name, (low, high) in pieces.items():
        if name not in axes:
            raise Refused(
                f"{name} is not a swept axis{suggestion(near_miss(name, axes))}; "
                f"expected: {' or '.join(axes) or 'none, since this is a single point'}"
            )
        group = data[seen.group if name in data[seen.group] else "start"]
        spacing = group[name]["spacing"] if isinstance(group[name], dict) else "linear"
        group[name] = {"start": low, "stop": high, "num": len(axes[name]), "spacing": spacing}
    if config.method.impact == "exact":  # find the number of steps that the piece needs
        enough = load_config({**data, "method": {**data["method"], "steps_per_period": None}})
        steps = max(each.sweep.spec.steps_per_period for each in (config, enough))
        data["method"]["steps_per_period"] = steps
    return load_config(data)
