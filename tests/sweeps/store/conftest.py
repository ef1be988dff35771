"""The data that interrupted and resumed writing must give."""

import pytest

from tests.helpers.sweep_files import data
from tests.helpers.written_files import fill_blocks


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the data of a file written without interruption."""
    path = tmp_path_factory.mktemp("whole") / "whole.h5"
    fill_blocks(path)
    return data(path)
