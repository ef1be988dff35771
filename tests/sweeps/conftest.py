"""Fixtures: a folder for every test, and the sweeps and the cluster that test files share."""

import logging
import shutil
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from commands import SMALL, WORKERS
from sweep_files import OVER_STARTS, run_in
from sweeps import load_config, open_sweep
from sweeps.grid import Grid
from sweeps.store import Schema, SweepWriter, sweep_writer
from written_files import FIXED, SAMPLES, random_numbers, spec_of


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, request):
    """Change to an empty folder, with the ``CONFIG`` of the test file as sweep.yaml."""
    monkeypatch.chdir(tmp_path)
    if hasattr(request.module, "CONFIG"):
        Path("sweep.yaml").write_text(request.module.CONFIG)
    return tmp_path


@pytest.fixture(autouse=True, scope="session")
def short_trials():
    """Estimate the time of a run in a tenth of the usual time; test_limits.py tests it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sweeps.engine.estimate._TRIAL", 0.01)
        yield


@pytest.fixture
def stop_after(monkeypatch):
    """Return a context manager that interrupts a run after `count` blocks of `size` points."""

    @contextmanager
    def stopping(count, size):
        write, written = SweepWriter.write, []

        def writing(self, block, results):
            write(self, block, results)
            written.append(block)
            if len(written) == count:
                raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(SweepWriter, "write", writing)
            patch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: size)
            yield

    return stopping


@pytest.fixture
def random_sweep(tmp_path):
    """Return a function that writes a sweep of random numbers and opens it."""
    with random_sweeps(tmp_path) as make:
        yield make


@pytest.fixture(scope="module")
def shared_sweep(tmp_path_factory):
    """Return the same function as `random_sweep`, for sweeps shared by several tests."""
    with random_sweeps(tmp_path_factory.mktemp("shared")) as make:
        yield make


@contextmanager
def random_sweeps(folder):
    opened = []

    def make(
        axes,
        *,
        sections=5,
        impacts=3,
        with_trajectory=True,
        name="a test",
        fixed=FIXED,
        diagnostics=(),
        phase=0.5,
        **changed,
    ):
        fixed = {key: value for key, value in fixed.items() if key not in axes}
        grid = Grid({key: np.asarray(values, float) for key, values in axes.items()}, fixed)
        values = {**fixed, **axes}
        configuration = {
            "name": name,
            "start": {key: values.pop(key) for key in ("x0", "v0")},
            "oscillator": values,
            "method": {"integrator": "newmark", "impact": "cubic", "steps_per_period": 64},
            "record": {"transient": 1000, "periods": 7, "phase": phase},
        }
        widths = {"section": sections, "impact": impacts, "sample": SAMPLES * with_trajectory}
        path = folder / f"{len(opened)}.h5"
        schema = Schema.of(
            grid,
            grid.blocks(grid.size),
            spec_of(widths, diagnostics),
            {
                "name": name,
                "configuration": load_config(configuration).to_yaml(),
                "numerics": "",
            },
        )
        with sweep_writer(path, schema) as store:
            store.write(
                tuple(slice(0, n) for n in grid.shape),
                {**random_numbers(grid.size, widths), **changed},
            )
            store.finish()
        opened.append(open_sweep(path))
        return opened[-1]

    yield make
    for dataset in opened:
        dataset.close()


@pytest.fixture(scope="session")
def computed_starts(tmp_path_factory):
    """Return a function that runs ``OVER_STARTS`` with overrides and opens the file."""
    folder, opened = tmp_path_factory.mktemp("runs"), {}

    def make(*overrides):
        if overrides not in opened:
            name = f"{len(opened)}.h5"
            opened[overrides] = open_sweep(run_in(folder, OVER_STARTS, *overrides, name=name))
        return opened[overrides]

    yield make
    for dataset in opened.values():
        dataset.close()


@pytest.fixture(scope="session")
def small_run(tmp_path_factory):
    return run_in(tmp_path_factory.mktemp("small"), SMALL)


@pytest.fixture
def ran(folder, small_run):
    """Copy the file of a run of ``SMALL`` to the folder, as small.h5."""
    shutil.copy(small_run, "small.h5")


@pytest.fixture(scope="module")
def cluster():
    """Return a local Dask cluster."""
    from distributed import LocalCluster

    options = {"n_workers": WORKERS, "threads_per_worker": 1, "dashboard_address": ":0"}
    with LocalCluster(**options, silence_logs=logging.CRITICAL) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def client(cluster):
    """Return a client of the cluster."""
    from distributed import Client

    with Client(cluster, set_as_default=False) as client:
        yield client
