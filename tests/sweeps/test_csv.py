"""Tables as CSV files: whole or not at all."""

import pytest

from sweeps.analysis.csv_tables import write_rows


def failing():
    yield [1, 2]
    raise OSError(28, "No space left on device")


def test_a_table_is_written_whole_or_not_at_all(tmp_path):
    """A failure leaves what was there before, and nothing beside it."""
    path = tmp_path / "a.csv"
    write_rows(path, ["a", "b"], [[1, 2.5], ["x, y", ""]])
    assert path.read_bytes() == b'a,b\n1,2.5\n"x, y",\n'
    with pytest.raises(OSError, match="No space"):
        write_rows(path, ["a", "b"], failing())
    assert path.read_bytes().startswith(b"a,b\n1,2.5\n")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


def test_a_link_stays_a_link(tmp_path):
    link = tmp_path / "link.csv"
    link.symlink_to(tmp_path / "a.csv")
    write_rows(link, ["a"], [[1]])
    assert link.is_symlink() and (tmp_path / "a.csv").read_text() == "a\n1\n"


def test_links_in_a_loop_end_in_no_traceback_of_theirs(tmp_path):
    """The table replaces the link that was named."""
    for one, other in (("a.csv", "b.csv"), ("b.csv", "a.csv")):
        (tmp_path / one).symlink_to(tmp_path / other)
    write_rows(tmp_path / "a.csv", ["a"], [[1]])
    assert (tmp_path / "b.csv").read_text() == "a\n1\n"


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(IsADirectoryError):
        write_rows(tmp_path, ["a"], [[1]])
