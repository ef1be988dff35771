"""YAML to a checked `SweepConfig`, with the line of every key.

``values.py`` defines the forms of a value, ``points.py`` the table of points, ``groups.py`` the
groups of keys, each key checked on its own, ``rig.py`` the group of a rig, and ``sweep.py`` the
whole configuration, with the `Sweep` that it computes and the schema for editors. ``loading.py``
reads the YAML, writes the errors and knows synonyms of the keys; ``checks.py`` checks keys
together, and completes the defaults that depend on several of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def scenes(ending: str = ".yaml") -> Mapping[str, str]:
    """Return the text of every scene by its name; with ``.csv``, the tables that belong to scenes.

    The files are those of ``configs/``, which a wheel contains as ``sweeps/scenes``.
    """
    from importlib.resources import files

    folder = files("sweeps") / "scenes"
    if not folder.is_dir():  # in a checkout
        folder = Path(__file__).parents[2] / "configs"
    names = sorted(file.name for file in folder.iterdir() if file.name.endswith(ending))
    return {Path(name).stem: (folder / name).read_text(encoding="utf-8") for name in names}
