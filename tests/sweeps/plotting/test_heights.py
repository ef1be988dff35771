"""No picture is higher than a printed page unless it is asked for."""

import numpy as np
import pytest

from sweeps import open_sweep, run_sweep
from sweeps.plotting import Page, integrity, table_panels


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    file = tmp_path_factory.mktemp("table") / "out.h5"
    names = ["h", "R", "omega", "p", "f", "clearance", "x0", "v0"]
    points = {name: np.linspace(0.4, 0.5, 5) for name in names}
    record = {"transient": 5, "periods": 4, "diagnostics": ["period"]}
    return run_sweep({"points": points, "record": record}, file)


@pytest.mark.parametrize(("width", "panels"), [(3.4, 6), (5.0, 8), (7.0, 8)])
def test_a_table_fits_a_page_and_counts_the_columns_left_out(table, width, panels):
    with open_sweep(table) as dataset:
        figure = table_panels(dataset, page=Page(width=width))
    assert figure.get_figheight() <= 9.0
    assert len([panel for panel in figure.axes if panel.get_xlabel()]) == panels
    words = {text.get_text() for text in figure.legends[0].get_texts()}
    assert ("2 further columns" in words) == (panels < 8)


def test_chosen_columns_and_a_height_are_drawn_as_asked_for(table):
    names = ["h", "R", "omega", "p", "f", "clearance", "x0"]
    with open_sweep(table) as dataset:
        figure = table_panels(dataset, axes=names, page=Page(width=3.4))
        high = table_panels(dataset, page=Page(width=3.4, height=14.0))
    assert len([panel for panel in figure.axes if panel.get_xlabel()]) == 7
    assert high.get_figheight() == 14.0


def test_an_integrity_picture_fits_a_page(tmp_path):
    starts = {"x0": {"start": -3, "stop": 0, "num": 6}, "v0": {"start": -2, "stop": 2, "num": 6}}
    oscillator = {"h": 0.05, "R": 0.8, "omega": [2.6, 2.7], "f": 1.0}
    scene = {"oscillator": oscillator, "start": starts, "record": {"transient": 200}}
    with open_sweep(run_sweep(scene, tmp_path / "out.h5")) as dataset:
        assert integrity(dataset, page=Page(width=3.4)).get_figheight() <= 9.0
