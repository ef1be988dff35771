"""A complete file, and the data that interrupted and resumed writing must give."""

import pytest

from tests.helpers.sweep_files import data
from tests.helpers.written_files import fill_blocks


@pytest.fixture(scope="package")
def finished_file(tmp_path_factory):
    """Return a file written without interruption, to be copied."""
    path = tmp_path_factory.mktemp("whole") / "whole.h5"
    fill_blocks(path)
    return path


@pytest.fixture(scope="module")
def whole(finished_file):
    return data(finished_file)
