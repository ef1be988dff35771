"""YAML to a checked `SweepConfig`, with the line of every key; the `scenes`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def scenes(ending: str = ".yaml") -> Mapping[str, str]:
    """Return the text of every scene by its name; with ``.csv``, the tables that scenes have."""
    from importlib.resources import files

    folder = files("sweeps") / "scenes"
    if not folder.is_dir():  # in a checkout
        folder = Path(__file__).parents[2] / "configs"
    names = sorted(file.name for file in folder.iterdir() if file.name.endswith(ending))
    return {Path(name).stem: (folder / name).read_text(encoding="utf-8") for name in names}
