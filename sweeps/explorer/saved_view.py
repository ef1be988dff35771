"""Saving a view as a configuration in YAML, from which `vibroimpact` draws the same picture."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

from sweeps.config.sweep import SweepConfig
from sweeps.explorer.view import DIAGRAM_TAB, View
from sweeps.store.replacing import writing
from sweeps.text import command


def write_yaml(view: View, config: SweepConfig, folder: Path) -> Path:
    """Write the configuration of the picture in the open tab to a new file in a folder."""
    names = (f"{view.name}-view-{number}" for number in itertools.count(1))
    name = next(name for name in names if not os.path.lexists(folder / f"{name}.yaml"))
    path = folder / f"{name}.yaml"
    text = _commands(view, name) + config.model_copy(update={"name": name}).to_yaml()
    with writing(path, "configuration", only_new=True) as new:
        new.write(text.encode())
    return path


def _commands(view: View, name: str) -> str:
    """Return a comment with the commands that draw the picture."""
    options = f"--kind {('bifurcation', 'map', 'basins')[view.tab]}"
    if view.tab == DIAGRAM_TAB:
        options += f" --coordinate {view.ordinate} --xlim={view.xlim[0]!r}:{view.xlim[1]!r}"
        if view.ylim is not None:
            options += f" --ylim={view.ylim[0]!r}:{view.ylim[1]!r}"
    run, plot = command("run", Path(f"{name}.yaml")), command("plot", Path(f"{name}.h5"))
    return (
        "# Saved by vibroimpact explore. It is run, and drawn as it was seen, with\n"
        f"#   {run}\n#   {plot} {options}\n"
    )
