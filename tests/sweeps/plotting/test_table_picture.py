"""The picture of a sweep over a table, and commands of a line or a plane, which refuse a table."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_array_equal

from sweeps import open_sweep, plotting, run_sweep
from sweeps.errors import Refused
from tests.helpers.commands import accepted, refused
from tests.sweeps.config.test_points import FIXED, GRIDS, RECORD, shuffled, write_csv

CONFIG = f"points: table.csv\n{FIXED}\n{RECORD}\n"


@pytest.mark.slow
def test_commands_of_a_line_or_a_plane_refuse_a_table(unpainted):
    write_csv({"R": [0.5, 0.6], "omega": [2.0, 2.1], "note": ["a", "b"]})
    accepted("run", "sweep.yaml", "-o", "out.h5", "--quiet")
    table = "needs a swept axis, and the points of this file are the rows of a table"
    for options in (["--kind", "map"], ["--kind", "bifurcation"], ["--kind", "attractors"]):
        assert table in refused("plot", "out.h5", *options)
    assert "basins need two of x0, v0, phase" in refused("plot", "out.h5", "--kind", "basins")
    assert "not for table" in refused("plot", "out.h5", "--exact")
    assert table in refused("info", "out.h5", "--bifurcations")
    assert "no axis to zoom into" in refused("zoom", "out.h5", "omega=2:2.05")
    assert "no rows of the table differ" in refused("attractors", "out.h5")
    assert "there is no omga (did you mean omega?)" in refused("plot", "out.h5", "--axis", "omga")
    assert "note is not a number for each point" in refused("plot", "out.h5", "--quantity", "note")
    accepted("plot", "out.h5", "--at", "point=2")  # the motion of a row
    accepted("info", "out.h5")


@pytest.mark.slow
def test_the_picture_of_a_table_has_a_panel_for_each_column_that_varies():
    columns, _ = shuffled(GRIDS["plain"])
    weight = np.arange(columns["R"].size) * 0.5
    points = {**columns, "x0": np.zeros(weight.size), "weight": weight}
    run_sweep({"points": points, **yaml.safe_load(f"{FIXED}\n{RECORD}")}, "out.h5")
    with open_sweep("out.h5") as dataset:
        figure = plotting.table_panels(dataset, quantity="impulse")
        assert len(figure.axes) == 3  # x0 does not vary
        for panel, name in zip(figure.axes, ("R", "omega", "weight"), strict=True):
            (drawn,) = panel.collections
            assert_array_equal(drawn.get_offsets()[:, 0], dataset[name])
            assert_array_equal(drawn.get_offsets()[:, 1], dataset["impulse"])
            assert len(np.unique(drawn.get_facecolors(), axis=0)) > 2  # classes
        (panel,) = plotting.table_panels(dataset, axes=["impulse"], quantity="lyapunov").axes
        assert_array_equal(panel.collections[0].get_offsets()[:, 0], dataset["impulse"])
        with pytest.raises(Refused, match="point cannot be fixed here"):
            plotting.table_panels(dataset, at={"point": 3.0})
        plotting.plot(dataset, "out.svg")
        svg = Path("out.svg").read_text()
        assert "transient: " in svg and "points:" not in svg  # a million rows would take minutes
