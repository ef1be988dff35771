"""The notebook in configs/, run cell by cell: what a reader of it sees."""

import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import sweeps

CONFIGS = Path(sweeps.__file__).parents[1] / "configs"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the kernel's own libraries
def test_the_notebook_shows_a_bar_and_every_figure_once(tmp_path):
    shutil.copy(CONFIGS / "quickstart.yaml", tmp_path)
    notebook = nbformat.read(CONFIGS / "pictures.ipynb", as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs for cell in code)  # stripped
    NotebookClient(
        notebook, timeout=600, kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()  # fmt: skip
    outputs = {cell.id: cell.outputs for cell in code}
    assert "%" in str(outputs["run"]) or "points" in str(outputs["run"])
    for name in ("diagram", "trajectory", "panels"):
        images = [out for out in outputs[name] if "image/png" in out.get("data", {})]
        assert len(images) == len(outputs[name]) == 1, name
