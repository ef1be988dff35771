"""Check that a file belongs to the sweep that resumes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from sweeps.errors import StoreError
from sweeps.store.layout import Layout
from sweeps.store.reader import SweepFile


def refuse_other(sweep: SweepFile, layout: Layout) -> None:
    """Refuse to go on with a file that another sweep than that of `layout`, or other code, began.

    Raises
    ------
    StoreError
        If the configurations, the grids or the code that computes differ; it names the keys.
    """
    old, new = sweep.layout, layout
    differing: list[str] = []
    for attribute in ("configuration", "computation"):  # the second follows from the first
        was, now = (str(layout.attributes.get(attribute, "{}")) for layout in (old, new))
        differing = differing or _differences(was, now)
    if old.attributes["numerics"] != new.attributes["numerics"]:
        differing.append("the code that computes is another version")
    if not differing and not _has_grid(old, new):
        differing.append("the axes have other values or another order")
    if differing:
        raise StoreError(
            f"{sweep.path} cannot be resumed: {'; '.join(differing)}; give --overwrite to replace "
            "it, or -o for another file"
        )


def _differences(old: str, new: str) -> list[str]:
    """Say in which keys two configurations differ, and what these were and are; not the name."""
    if old == new:
        return []
    was, now = _flat(yaml.safe_load(old)), _flat(yaml.safe_load(new))
    return [
        f"{key} was {was.get(key, 'not given')} and is {now.get(key, 'not given')}"
        for key in sorted({*was, *now} - {"name"})
        if was.get(key) != now.get(key)
    ]


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Return the leaves of a tree by their dotted keys."""
    leaves: dict[str, object] = {}
    for key, value in tree.items():
        deeper = isinstance(value, dict)
        leaves |= _flat(value, f"{prefix}{key}.") if deeper else {f"{prefix}{key}": value}
    return leaves


def _has_grid(old: Layout, new: Layout) -> bool:
    """Return whether a file has the grid of a layout, and further values only where refined."""
    if list(old.axes) != list(new.axes):
        return False
    pairs = [(old.axes[axis], new.axes[axis]) for axis in new.axes]
    if old.refined:
        return all(np.isin(values, stored).all() for stored, values in pairs)
    return all(np.array_equal(stored, values) for stored, values in pairs)
