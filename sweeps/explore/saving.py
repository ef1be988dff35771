"""What is seen, as a configuration that `vibroimpact run` turns into the same picture."""

from __future__ import annotations

import itertools
from pathlib import Path

from sweeps.config.sweep import SweepConfig
from sweeps.errors import Failed
from sweeps.explore.view import DIAGRAM, View


def write_yaml(view: View, config: SweepConfig, folder: Path) -> Path:
    """Write the configuration of the picture in the tab of the view to a new file in a folder.

    Raises
    ------
    Failed
        If it cannot be written.
    """
    for number in itertools.count(1):
        name = f"{view.name}-view-{number}"
        path = folder / f"{name}.yaml"
        text = _heading(view, name) + config.model_copy(update={"name": name}).to_yaml()
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
        except FileExistsError:
            continue
        except OSError as error:
            raise Failed(f"{path} cannot be written: {error.strerror}") from error
        return path
    raise AssertionError


def _heading(view: View, name: str) -> str:
    """Return a comment that says how the picture is drawn."""
    options = f"--kind {('bifurcation', 'map', 'basins')[view.tab]}"
    if view.tab == DIAGRAM:
        options += f" --coordinate {view.ordinate} --xlim={view.xlim[0]!r}:{view.xlim[1]!r}"
        if view.ylim is not None:
            options += f" --ylim={view.ylim[0]!r}:{view.ylim[1]!r}"
    return (
        "# Saved by vibroimpact explore. It is run, and drawn as it was seen, with\n"
        f"#   vibroimpact run {name}.yaml\n#   vibroimpact plot {name}.h5 {options}\n"
    )
