"""Files of refined sweeps: what is kept, added, resumed and told."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from commands import accepted
from sweep_files import REFINED, flip, found, refined
from sweeps import open_sweep
from sweeps.grid import Grid
from sweeps.store import sweep_writer
from written_files import WIDTHS, results, schema


@pytest.mark.slow
def test_the_grid_keeps_its_data_and_the_new_points_are_told(around, tmp_path):
    plain = refined(tmp_path, "refine=null")
    with open_sweep(around) as dataset, open_sweep(plain) as grid:
        omega = dataset["omega"].values
        assert (np.diff(omega) > 0.0).all() and np.isin(grid["omega"], omega).all()
        assert dataset.attrs["points_added"] == len(omega) - 21
        beside = {one.low for one in found(around)} | {one.high for one in found(around)}
        kept = [w for w in grid["omega"].values if w not in beside]
        for name in grid.data_vars:
            same = dataset[name].sel(omega=kept).values
            assert np.array_equal(same, grid[name].sel(omega=kept).values, equal_nan=True)
    with xr.open_dataset(around, engine="h5netcdf") as dataset:
        assert dataset["poincare_x"].dims == ("omega", "section")
        assert (dataset["status"] == 1).all()


def test_a_new_point_records_the_attractor(around):
    """1e-8 from the flip a transient would have to be 1e8 periods long."""
    first = found(around)[0]
    with open_sweep(around) as dataset:
        for value, m in ((first.low, 1), (first.high, 2)):
            point = dataset.sel(omega=value)
            x = point["poincare_x"].values
            assert point["period"] == m
            assert np.abs(x[m:] - x[:-m]).max() < 1e-10


@pytest.mark.slow
def test_resume_ends_with_the_same_data(around, tmp_path, monkeypatch):
    """Also where the run was left between the grid and its refinement."""

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("sweeps.engine.refine.Refinement", interrupted)
        refined(tmp_path)
    with open_sweep(tmp_path / "out.h5") as dataset:
        assert dataset.sizes["omega"] == 21 and (dataset["status"] != -1).all()
    for _ in range(2):  # the second has nothing to do
        path = refined(tmp_path, resume=True, threads=1)
        with open_sweep(path) as again, open_sweep(around) as first:
            assert again.drop_attrs().identical(first.drop_attrs())
            for name in first.variables:
                assert again[name].values.tobytes() == first[name].values.tobytes()


def test_points_before_and_behind_all_others_are_added_too(tmp_path):
    """By the writer, in a sweep of several blocks; one replaces a point of the grid."""
    grid = Grid({"omega": np.linspace(1.0, 2.0, 5)}, {})
    widths = {**WIDTHS, "sample": 0}
    plan = schema(grid, block_size=2, widths=widths)
    added = {
        value: {
            name: array[0] for name, array in results((slice(i, i + 1),), widths=widths).items()
        }
        for i, value in enumerate([0.5, 1.1, 1.3, 1.45, 1.5, 3.0, 2.5], 100)
    }
    points = dict(added)
    with sweep_writer(tmp_path / "out.h5", plan) as store:
        for block in store.pending():
            given = results(block, widths=widths)
            store.write(block, given)
            for i, value in enumerate(grid.axes["omega"][block].tolist()):
                points.setdefault(value, {name: array[i] for name, array in given.items()})
        store.finish(added, compressed=True)
    with open_sweep(tmp_path / "out.h5") as dataset:
        assert dataset.attrs["points_added"] == 6
        assert dataset["omega"].values.tolist() == sorted(points)
        for name in dataset.data_vars:
            expected = [points[value][name] for value in sorted(points)]
            np.testing.assert_array_equal(dataset[name].values, expected)


# -- what is told --------------------------------------------------------------------------------


@pytest.mark.slow
def test_info_lists_the_brackets(cascade):
    lines = accepted("info", cascade, "--bifurcations").splitlines()
    assert lines[0].split() == ["omega", "kind", "classes", "between"]
    value, *classes = lines[1].split()[:5]
    assert classes == ["flip", "1/1", "->", "2/2"]
    assert float(value) == pytest.approx(flip(1, 2.6, 2.7), rel=1e-11)
    (ratios,) = (line for line in lines if line.startswith("cascade: omega = 2.653347"))
    assert "ratios of the distances 4." in ratios


def test_the_plan_says_that_points_are_added():
    Path("sweep.yaml").write_text(REFINED)
    plan = accepted("run", "sweep.yaml", "-o", "out.h5", "--dry-run")
    assert "where the class of the motion changes, halved 17 times" in plan
