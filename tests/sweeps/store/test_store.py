"""Written data can be read back by this package and xarray, from complete and partial files."""

import os
import pickle
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from sweeps.config.groups import DIAGNOSTICS
from sweeps.grid import Grid
from sweeps.store.parts import Parts
from sweeps.store.variables import VARIABLES, record_widths
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.written_files import (
    CONFIGURATION,
    GRID,
    assert_holds,
    begun,
    block_results,
    fill_blocks,
    grid_results,
    part,
    schema,
    spec_of,
)
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

OUT = Path("out.h5")


def write_all(path, expected, *, grid=GRID, size=12, backwards=False, compressed=False):
    with begun(path, schema(grid, block_size=size)) as (store, pending):
        for block in pending[:: -1 if backwards else 1]:
            store.write(block, part(expected, block))
        store.finish(compressed=compressed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "compressed", "each_alone", "boxes"),
    [(1, True, True, 12), (5, False, True, 4), (5, True, False, 2), (12, False, False, 1)],
)
def test_every_variable_comes_back(monkeypatch, size, compressed, each_alone, boxes):
    """The blocks of a row are written together."""
    if each_alone:
        monkeypatch.setattr("sweeps.store.parts._JOINED", 0)
    written, pieces = [], Parts.pieces

    def noted(parts):
        for piece in pieces(parts):
            written.append(piece[0])
            yield piece

    monkeypatch.setattr(Parts, "pieces", noted)
    expected = grid_results()
    write_all(OUT, expected, size=size, backwards=size == 5, compressed=compressed)
    assert written.count("status") == boxes
    with open_sweep(OUT) as dataset:
        assert set(dataset.data_vars) == set(VARIABLES)
        assert_holds(dataset, expected)
        for name, variable in VARIABLES.items():
            record = () if variable.dimension is None else (variable.dimension,)
            assert dataset[name].dims == ("R", "omega", *record)
            assert dataset[name].dtype == variable.dtype
            named = variable.unit in ("1", "rad")
            assert dataset[name].attrs.get("units") == (variable.unit if named else None)
    with h5py.File(OUT) as file:
        assert {file[name].compression for name in VARIABLES} == {"gzip" if compressed else None}
        assert all(file[name].fletcher32 for name in VARIABLES)


@pytest.mark.slow
@pytest.mark.parametrize(("followed", "size"), [("h", 7), ("R", 60), ("f", 7)])
def test_blocks_of_many_shapes_and_large_records_come_back(followed, size):
    """Of followed chains, and of more than fits into a chunk of the file."""
    axes = {"h": np.arange(3.0), "R": np.linspace(0.0, 1.0, 4), "f": np.arange(5.0)}
    grid, widths = Grid(axes, {"omega": 1.0}), {"section": 12_007, "impact": 0, "sample": 0}
    path, plan = OUT, schema(grid, widths=widths, diagnostics=())
    object.__setattr__(plan, "blocks", tuple(grid.blocks(size, followed)))
    results = partial(block_results, widths=widths)
    fill_blocks(path, compressed=followed == "R", plan=plan, results=results)
    with open_sweep(path) as dataset:
        # A width of zero leaves the variables out.
        assert set(dataset.sizes) == {"h", "R", "f", "section"}
        assert {*dataset.data_vars} == {*record_widths(spec_of(widths, ()))}
        for block in plan.blocks:
            x = results(block)["poincare_x"].reshape(dataset["poincare_x"][block].shape)
            np.testing.assert_array_equal(dataset["poincare_x"][block].values, x)
            assert (dataset["status"][block] == 0).all()


@pytest.mark.slow
def test_xarray_opens_it_with_coordinates_and_attributes():
    write_all(OUT, grid_results())
    with xr.open_dataset(OUT, engine="h5netcdf") as dataset, open_sweep(OUT) as ours:
        xr.testing.assert_identical(dataset, ours.drop_vars(["a", "phase"]))  # not in the grid
        assert set(dataset.sizes) == {"R", "omega", "section", "impact", "sample", "exponent"}
        for name, values in GRID.axes.items():
            np.testing.assert_array_equal(dataset[name].values, values)
        for name, value in GRID.fixed.items():
            assert dataset.coords[name].shape == () and dataset[name] == value
        for name in (*GRID.axes, *GRID.fixed):
            assert dataset[name].attrs["long_name"] == PARAMETERS[name].meaning
            named = PARAMETERS[name].unit in ("1", "rad")
            assert dataset[name].attrs.get("units") == (PARAMETERS[name].unit if named else None)
            assert dataset[name].attrs["symbol"] == PARAMETERS[name].symbol
        assert dataset["section"].values.tolist() == list(range(11, 31))
        assert dataset["impact"].values.tolist() == [0, 1, 2]
        assert dataset["exponent"].values.tolist() == [0, 1]
        assert dataset["sample"].values.tolist() == list(range(6))
        meanings = dataset["status"].attrs["flag_meanings"].split()
        flags = dict(zip(meanings, dataset["status"].attrs["flag_values"], strict=True))
        assert flags == {status.name.lower(): status for status in Status}
        assert dataset.attrs["configuration"] == CONFIGURATION
        assert dataset.attrs["name"] == "a test"
        assert dataset.attrs["numpy_version"] == np.__version__
        assert 0.0 < dataset.attrs["duration"] < 60.0
        started = dataset.attrs["started"].removesuffix("+00:00")
        assert np.datetime64(started) > np.datetime64("2024")
        assert "coordinates" not in dataset.attrs and "blocks" not in dataset


@pytest.mark.parametrize("compressed", [False, True])
def test_a_single_point_has_no_axes(compressed):
    grid = Grid({}, dict.fromkeys(PARAMETERS, 0.5))
    given = block_results((), 6)
    with begun(OUT, schema(grid)) as (store, _):
        with open_sweep(OUT) as dataset:
            assert dataset["status"] == Status.PENDING and np.isnan(dataset["rest_fraction"])
            assert dataset["chatters"] == -1 and np.isnan(dataset["poincare_x"]).all()
        store.write((), given)
        store.finish(compressed=compressed)
    with open_sweep(OUT) as dataset:
        assert dataset["status"].shape == ()
        assert_holds(dataset, {name: array[0] for name, array in given.items()})


@pytest.mark.parametrize(
    ("diagnostics", "expected"),
    [
        ((), set()),
        (("period",), {"period", "period_impacts"}),
        (("lyapunov",), {"lyapunov"}),
        (("extremes",), {"x_min", "x_max"}),
        (DIAGNOSTICS, {"period", "period_impacts", "lyapunov", "x_min", "x_max"}),
    ],
)
def test_diagnostics_not_asked_for_are_left_out(diagnostics, expected):
    held = record_widths(spec_of(diagnostics=diagnostics))
    with begun(OUT, schema(diagnostics=diagnostics)):
        with open_sweep(OUT) as dataset:
            assert set(dataset.data_vars) == set(held)
            of_diagnostics = {"period", "period_impacts", "lyapunov", "x_min", "x_max"}
            assert of_diagnostics & set(held) == expected
            assert ("exponent" in dataset.sizes) == ("lyapunov" in diagnostics)
    needed = {variable.diagnostic for variable in VARIABLES.values()}
    assert needed == {None, "longest", *DIAGNOSTICS}


@pytest.mark.parametrize("blocks", [4, None])
def test_a_sweep_is_read_lazily_and_by_any_index(blocks):
    fill_blocks(OUT, blocks)
    with open_sweep(OUT) as loaded:
        loaded.load()
    choices = [
        {"R": 1}, {"R": [1, 0], "omega": slice(4, None, -2)}, {"omega": [5, 0, 3], "section": -1},
        {"R": slice(1, 1)}, {"omega": []}, {"omega": [3, 3, 1]},
        {"omega": 2, "R": 0, "section": slice(3, 17, 5)}, {"R": -1, "omega": 0},
        {"R": 0, "section": [1, 3]}, {"omega": [3, 1], "section": 2},
    ]  # fmt: skip
    with open_sweep(OUT) as dataset:
        for choice in choices:
            found = dataset["poincare_x"].isel(choice)
            xr.testing.assert_identical(found.load(), loaded["poincare_x"].isel(choice))
            assert not dataset["poincare_x"].variable._in_memory


def test_an_opened_file_is_sent_to_another_process_and_may_be_one_of_many():
    fill_blocks(OUT)
    with open_sweep(OUT) as first, xr.set_options(file_cache_maxsize=1), open_sweep(OUT):
        sent = pickle.loads(pickle.dumps(first))
        assert not first["impulse"].variable._in_memory
        xr.testing.assert_identical(sent.load(), first.load())


def test_a_block_that_does_not_fit_is_not_written():
    block = (slice(0, 1), slice(0, 2))
    with begun(OUT, schema()) as (store, _):
        given = block_results(block)
        with pytest.raises(ValueError, match=r"size 18"):
            store.write(block, {**given, "impact_v": np.zeros((2, 9))})
        with pytest.raises(KeyError, match="status"):
            store.write(block, {k: v for k, v in given.items() if k != "status"})
        with pytest.raises(ValueError, match="not in"):
            store.write((slice(0, 1), slice(0, 5)), given)
        assert os.listdir(f"{OUT}.parts") == ["schema.h5"]


@pytest.mark.parametrize("blocks", [1, None], ids=["incomplete", "complete"])
def test_a_file_from_before_a_parameter_was_added_has_its_default(blocks):
    """As a coordinate of the points, with its meaning and its unit in the sweep."""
    assert "a" not in GRID.fixed
    plan = schema()
    plan.attributes["length_unit"] = "mm"
    fill_blocks(OUT, blocks, plan=plan)
    with open_sweep(OUT) as dataset:
        assert dataset["a"].item() == 0.0 and dataset["h"].item() == 0.1
        assert dataset["a"].attrs == {
            "long_name": PARAMETERS["a"].meaning, "units": "mm", "symbol": "a",
        }  # fmt: skip
