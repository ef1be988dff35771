"""The notebook in configs/, run cell by cell: what a reader of it sees."""

import ast
import json
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from matplotlib.figure import Figure

import sweeps

CONFIGS = Path(sweeps.__file__).parents[1] / "configs"


def shown_by(cell, names):
    """Run a cell; return the value of its last line, as a notebook shows it, or else None."""
    *lines, last = ast.parse("".join(cell["source"])).body
    if not isinstance(last, ast.Expr):
        lines.append(last)
    exec(compile(ast.Module(lines, []), cell["id"], "exec"), names)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), cell["id"], "eval"), names)
    return None


@pytest.mark.slow
def test_the_notebook_shows_a_bar_and_every_figure_once(tmp_path, monkeypatch, capsys):
    shutil.copy(CONFIGS / "quickstart.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: None)
    notebook = json.loads((CONFIGS / "pictures.ipynb").read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in code)  # stripped
    names, shown = {}, {}
    for cell in code:
        value = shown_by(cell, names)
        # A figure of pyplot is shown at the end of its cell, and the value of the cell, too.
        shown[cell["id"]] = [*map(plt.figure, plt.get_fignums()), *[value] * (value is not None)]
        plt.close("all")
    names["sweep"].close()
    assert "points" in capsys.readouterr().err
    for name in ("diagram", "trajectory", "panels"):
        assert len(shown[name]) == 1 and isinstance(shown[name][0], Figure), name
        assert shown[name][0].axes, name
