"""Files are replaced whole or not at all, and only files are replaced."""

import os
import socket
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from sweeps.errors import Failed, StoreError
from sweeps.opened.export import write_csv
from sweeps.plotting.saving import save
from sweeps.store import replacing as module
from sweeps.store.replacing import check_target, identity, remove_leftovers, writing
from tests.helpers.written_files import fill_blocks, fill_disk, room_again


def written(path, text="new"):
    with writing(Path(path), "file") as new:
        new.write(text.encode())


def test_a_planted_draft_is_not_followed(monkeypatch):
    """Not even if its random name was guessed."""
    monkeypatch.setattr(module.secrets, "token_hex", lambda count: "0" * 2 * count)
    Path("victim").write_text("precious")
    module.draft_of(Path("a")).symlink_to("victim")
    with pytest.raises(Failed, match="a cannot be written: File exists"):
        written("a")
    assert Path("victim").read_text() == "precious" and not Path("a").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a link away")
def test_a_link_of_another_user_is_not_followed():
    Path("victim").write_text("precious")
    Path("a").symlink_to("victim")
    os.lchown("a", 65534, 65534)
    with pytest.raises(StoreError, match="a is a link of another user"):
        written("a")
    assert Path("victim").read_text() == "precious" and Path("a").is_symlink()


def fifo():
    os.mkfifo("a")


def unix_socket():
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("a")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (fifo, "a is a FIFO, not a regular file, and will not be replaced"),
        (unix_socket, "a is a socket"),
        (lambda: Path("a").symlink_to("/dev/null"), "a is a device"),
        (lambda: Path("a").mkdir(), "a is a directory"),
        (lambda: Path("a").symlink_to("a"), "'a' cannot be used: Too many levels of symbolic"),
        (lambda: Path("a").symlink_to("no/b"), "/no of the picture a, a link to .*/no/b, does"),
    ],
)
def test_what_is_no_file_is_refused_and_stays(make, said):
    make()
    before = identity(Path("a"))
    for attempt in (check_target, writing):
        with pytest.raises(StoreError, match=said):
            with attempt(Path("a"), "picture"):
                pass
    assert identity(Path("a")) == before and os.listdir() == ["a"]


@pytest.mark.parametrize("name", ["no/a", "file/a", "x" * 256, "a\0b", ""])
def test_a_path_that_no_file_can_have_is_refused(name):
    Path("file").touch()
    with pytest.raises(StoreError):
        check_target(Path(name), "picture")


def test_a_name_as_long_as_any_is_taken():
    name = "é" * 127 + "x"
    written(name)
    assert os.listdir() == [name]


def test_only_drafts_are_removed():
    left = module.draft_of(Path("a")).name
    start = left[: -len("01234567.new")]
    others = [".a.new", f"{start}0123456.new", ".a.mine.new", left.replace(".a.", ".ab.")]
    for name in (left, *others):
        Path(name).touch()
    remove_leftovers(Path("b"))
    assert left in os.listdir()
    remove_leftovers(Path("a"))
    assert sorted(os.listdir()) == sorted(others)


@pytest.mark.parametrize("names", [("a" * 60 + "1.h5", "a" * 60 + "2.h5"), ("a.h5", "a.h5.csv")])
def test_the_drafts_of_another_output_stay(names):
    """Also if the names begin alike; those of this output go, as only the lock allows them."""
    left = module.draft_of(Path(names[0]))
    left.touch()
    remove_leftovers(Path(names[1]))
    assert os.listdir() == [left.name]
    remove_leftovers(Path(names[0]))
    assert os.listdir() == []


def test_a_file_of_a_sweep_is_replaced_by_no_other_kind_of_file():
    fill_blocks("out.h5")
    before = Path("out.h5").read_bytes()
    Path("link").symlink_to("out.h5")
    for name in ("out.h5", "link"):
        with pytest.raises(StoreError, match=rf"{name} is the file of a sweep and will not be rep"):
            check_target(Path(name), "table")
        with pytest.raises(StoreError, match="give the file another name"):
            written(name)
    with pytest.raises(StoreError, match="is the file of a sweep"), writing(Path("a"), "file"):
        os.link("out.h5", "a")
    assert Path("out.h5").read_bytes() == Path("a").read_bytes() == before


@pytest.mark.parametrize("ending", ["png", "svg", "csv"])
def test_a_full_disk_is_one_failure_that_says_so(ending):
    figure, frame = Figure(), pd.DataFrame({"x": range(20_000)})
    figure.add_subplot().plot([1, 2])
    said = rf"^a\.{ending} cannot be written: File too large$"
    with pytest.raises(Failed, match=said), room_again():
        fill_disk(500)
        write_csv(Path("a.csv"), [frame]) if ending == "csv" else save(figure, Path(f"a.{ending}"))
    assert os.listdir() == []
