"""Files are replaced whole or not at all, and only files are replaced."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from sweeps.errors import Failed, StoreError
from sweeps.opened.export import write_csv
from sweeps.plotting.saving import save
from sweeps.store import replacing as module
from sweeps.store.replacing import check_target, identity, remove_leftovers, replacing, writing
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


def test_a_link_put_in_the_place_of_a_draft_is_not_written():
    """Where others may write to the folder, they may replace a draft while it is written."""
    Path("victim").write_text("precious")
    for write in (
        lambda path: written(path),
        lambda path: write_csv(path, [pd.DataFrame({"x": [1.0]})]),
        lambda path: save(Figure(), path),
        lambda path: fill_blocks(path, 0),
    ):
        with planted_links("victim"), pytest.raises(Failed, match="was replaced by another"):
            write(Path("a.h5" if "fill" in write.__code__.co_names[0] else "a.png"))
        assert Path("victim").read_text() == "precious"
        assert not Path("a.png").exists() and not Path("a.h5").exists()


@contextmanager
def planted_links(victim):
    """Replace each new draft by a link at once."""
    drafts = iter(range(1 << 30))

    def replaced(path, *arguments, **options):
        file = open(path, *arguments, **options)
        if path.suffix == ".new":
            path.rename(f"draft-{next(drafts)}")
            path.symlink_to(Path(victim).absolute())
        return file

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "open", replaced)
        yield


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


@pytest.mark.parametrize(
    ("name", "said"),
    [
        *((f"a{character}b.h5", f"has the character {character} in") for character in '<>:"|?*\\'),
        ("a.", "ends in a dot"),
        ("a ", "ends in a space"),
        ("con", "can be named con"),
        ("Aux.h5", "can be named Aux"),
        ("COM¹.h5", "can be named COM¹"),
        ("conin$", "can be named conin$"),
        ("a\nb.h5", r"has the character '\n' in"),
        ("a\x1fb.h5", r"has the character '\x1f' in"),
    ],
)
def test_a_name_that_windows_cannot_hold_is_refused_with_the_reason(name, said):
    with pytest.raises(
        StoreError, match=r"on Windows no file .*; give the output another name"
    ) as no:
        check_target(Path(name), "output")
    assert said in str(no.value)
    for similar in ("constant.h5", "a.b c.h5", "-σ=1;R[1]'&.h5"):
        check_target(Path(similar), "output")


def test_a_name_as_long_as_any_is_taken():
    name = "é" * 127 + "x"
    written(name)
    assert os.listdir() == [name]


def test_what_a_killed_process_left_is_removed_by_the_next():
    code = (
        "import os, signal, pathlib\n"
        "from sweeps.store.replacing import replacing\n"
        "with replacing(pathlib.Path('a')):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    killed = subprocess.run([sys.executable, "-c", code])
    assert killed.returncode == -signal.SIGKILL
    (left,) = os.listdir()
    assert left.startswith(".a.") and left.endswith(".new")
    start = left[: -len("01234567.new")]
    similar = start.replace(".a.", ".ab.") + left[-12:]
    others = [".a.new", f"{start}0123456.new", ".a.mine.new", similar]
    for name in others:
        Path(name).touch()
        os.utime(name, (1e9, 1e9))
    os.utime(left, (1e9, 1e9))
    written("b")
    assert left in os.listdir()
    with replacing(Path("a")):
        written("a")
        assert left not in os.listdir() and len(os.listdir()) == 3 + len(others)
    assert sorted(os.listdir()) == sorted(["a", "b", *others])


def test_the_draft_of_a_process_that_cannot_be_seen_stays(monkeypatch):
    """It is on another machine or in another container; the number may be that of nobody here."""
    with monkeypatch.context() as patch:
        patch.setattr(os, "getpid", lambda: 2**22 + 1)
        with replacing(Path("a")) as new:
            new.write(b"theirs")
            patch.undo()
            written("a")
    assert Path("a").read_bytes() == b"theirs" and os.listdir() == ["a"]


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


def test_a_new_file_replaces_none_that_was_made_meanwhile():
    with pytest.raises(StoreError, match="a exists, and is not replaced; remove it, or rename"):
        with writing(Path("a"), "configuration", only_new=True):
            Path("a").write_text("precious")
    assert Path("a").read_text() == "precious" and os.listdir() == ["a"]


@pytest.mark.parametrize("ending", ["png", "svg", "csv"])
def test_a_full_disk_is_one_failure_that_says_so(ending):
    figure, frame = Figure(), pd.DataFrame({"x": range(20_000)})
    figure.add_subplot().plot([1, 2])
    said = rf"^a\.{ending} cannot be written: File too large$"
    with pytest.raises(Failed, match=said), room_again():
        fill_disk(500)
        write_csv(Path("a.csv"), [frame]) if ending == "csv" else save(figure, Path(f"a.{ending}"))
    assert os.listdir() == []
