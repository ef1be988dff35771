"""The pages for developers say what is in every file, and where."""

import pytest

from tests.helpers.file_tables import PAGES, ROOT, with_table


@pytest.mark.parametrize("package", PAGES)
def test_the_table_of_files_is_that_of_the_docstrings(package):
    """After a new file or docstring: python -m tests.helpers.file_tables."""
    page = PAGES[package]
    assert page.read_text() == with_table(page, package)


def test_every_room_of_sweeps_has_a_row():
    """In the list of rooms at the top of the page."""
    text = PAGES["sweeps"].read_text()
    rooms = sorted(path.parent.name for path in (ROOT / "sweeps").glob("*/__init__.py"))
    assert [room for room in rooms if f"| `{room}/` |" not in text] == []
