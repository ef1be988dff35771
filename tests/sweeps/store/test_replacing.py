"""Files are replaced whole or not at all, and only files are replaced."""

import os
import resource
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from sweeps.analysis.tables import write_csv
from sweeps.errors import Failed, StoreError
from sweeps.plotting.saving import save
from sweeps.store import replacing as module
from sweeps.store.replacing import check_target, remove_leftovers, replacing, writing
from tests.helpers.written_files import fill_blocks


def written(path, text="new"):
    with writing(Path(path), "file") as new:
        new.write(text.encode())


def test_a_planted_draft_is_not_followed(monkeypatch):
    """Not even if its random name was guessed."""
    monkeypatch.setattr(module.secrets, "token_hex", lambda count: "0" * 2 * count)
    Path("victim").write_text("precious")
    Path(f".a.{os.getpid()}-00000000.new").symlink_to("victim")
    with pytest.raises(Failed, match="a cannot be written: File exists"):
        written("a")
    assert Path("victim").read_text() == "precious" and not Path("a").exists()


def test_a_link_put_in_the_place_of_a_draft_is_not_written():
    """Where others may write to the folder, they may replace a draft while it is written."""
    Path("victim").write_text("precious")
    for write in (
        lambda path: written(path),
        lambda path: write_csv(path, pd.DataFrame({"x": [1.0]})),
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


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
@pytest.mark.parametrize("options", [{}, {"resume": True}, {"overwrite": True}])
def test_the_folder_of_another_user_is_not_used_for_blocks(options):
    Path("a.h5.parts").mkdir()
    os.chown("a.h5.parts", 65534, 65534)
    with pytest.raises(StoreError, match=r"a\.h5\.parts belongs to another user"):
        fill_blocks("a.h5", **options)
    assert os.listdir() == ["a.h5.parts"] and os.listdir("a.h5.parts") == []


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
        (
            lambda: Path("a").symlink_to("no/b"),
            "/no of the picture a, a link to .*/no/b, does",
        ),
    ],
)
def test_what_is_no_file_is_refused_and_stays(make, said):
    make()
    before = os.lstat("a")
    for attempt in (check_target, writing):
        with pytest.raises(StoreError, match=said):
            with attempt(Path("a"), "picture"):
                pass
    assert os.lstat("a") == before and os.listdir() == ["a"]


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
    written("b")
    assert left in os.listdir()
    with replacing(Path("a")):  # its draft belongs to a living process
        written("a")
        assert left not in os.listdir() and len(os.listdir()) == 3
    # The same number of a process that ended before this one began, as in a container.
    left = Path(f".a.{os.getpid()}-01234567.new")
    left.touch()
    os.utime(left, (1e9, 1e9))
    others = [".a.new", ".a.1-0123456.new", ".a.mine.new", ".ab.1-01234567.new"]
    for name in others:
        Path(name).touch()
    remove_leftovers(Path("a"))
    assert sorted(os.listdir()) == sorted(["a", "b", *others])


@pytest.mark.parametrize("ending", ["png", "svg", "pdf", "csv"])
def test_a_full_disk_is_one_failure_that_says_so(ending):
    figure, frame = Figure(), pd.DataFrame({"x": range(20_000)})
    figure.add_subplot().plot([1, 2])
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, old[1]))
    try:
        with pytest.raises(Failed, match=rf"^a\.{ending} cannot be written: File too large$"):
            if ending == "csv":
                write_csv(Path("a.csv"), frame)
            else:
                save(figure, Path(f"a.{ending}"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert os.listdir() == []
