"""A full disk, before, during and at the end of a run, costs no block.

At 400 sizes: ``pytest -m campaign tests/sweeps/store/test_full_disk.py``.
"""

import resource
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from sweeps.errors import Failed
from tests.helpers.written_files import begun, block_results, fill_blocks, schema
from tests.sweeps.store.test_writer import done_of, last_block, resumed

#: A file beside the sweep, which stays.
CONFIG = "name: beside\n"


@contextmanager
def small_disk(size):
    """Limit the size of files, except those that the tests write."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(size), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_before_the_start_leaves_nothing(tmp_path):
    with pytest.raises(Failed, match=r"out\.h5 cannot be created: File too large$"):
        with small_disk(5000):
            fill_blocks("out.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["sweep.yaml"]


@pytest.mark.slow
def test_a_disk_that_fills_up_keeps_every_block_before(whole):
    fill_blocks("out.h5", 2)
    with pytest.raises(Failed, match=r"out\.h5 cannot be written: File too large$"):
        with small_disk(last_block().stat().st_size - 100):
            fill_blocks("out.h5", resume=True)
    assert done_of("out.h5", whole) == 4
    resumed(whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sizes", [5, pytest.param(400, marks=pytest.mark.campaign)], ids=["some", "many"]
)
@pytest.mark.parametrize("compressed", [False, True])
def test_a_disk_that_is_full_at_the_end_loses_nothing(whole, compressed, sizes):
    """Anywhere in the complete file: HDF5 alone would end the process."""
    fill_blocks("size.h5", compressed=compressed)
    full = Path("size.h5").stat().st_size
    Path("size.h5").unlink()
    with begun("out.h5", schema()) as (store, pending):
        for block in pending:
            store.write(block, block_results(block))
        for size in np.linspace(0, full - 100, sizes):
            with pytest.raises(Failed, match=r"out\.h5 cannot be completed: File too large$"):
                with small_disk(size):
                    store.finish(compressed=compressed)
    assert {path.name for path in Path().iterdir()} == {"out.h5.parts", "sweep.yaml"}
    assert done_of("out.h5", whole) == 12
    resumed(whole, compressed=compressed)
