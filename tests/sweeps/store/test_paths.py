"""Paths that are refused for writing or reading, and the lock of the single writer."""

import errno
import inspect
import os
import re
import shutil
import stat
import subprocess
import sys
import types
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from filelock import FileLock, Timeout
from matplotlib.backend_bases import FigureCanvasBase

from sweeps.errors import StoreError
from sweeps.store.paths import FORMAT, FORMAT_VERSION, check_output, check_room, open_regular
from sweeps.store.writer import sweep_writer
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.commands import call
from tests.helpers.places import ROOT
from tests.helpers.written_files import contents, fill_blocks

CONFIG = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 1.5, stop: 3.0, num: 40}, f: 1.0}
method: {integrator: newmark, impact: plain}
record: {transient: 3, periods: 4, impacts: 2}
output: out.h5
"""


@pytest.mark.parametrize("blocks", [2, None])
def test_an_existing_sweep_is_kept_unless_told(blocks):
    fill_blocks("out.h5", blocks)
    (path,) = Path().glob("out.h5*")
    before = contents(path)
    with pytest.raises(StoreError, match=f"{path} exists; resume it, overwrite it, or") as caught:
        fill_blocks("out.h5")
    assert "(--resume, --overwrite or -o; in Python resume, overwrite or out" in str(caught.value)
    assert contents(path) == before
    fill_blocks("out.h5", overwrite=True)
    open_sweep("out.h5").close()
    assert not Path("out.h5.parts").exists()


def text(content):
    return lambda path: Path(path).write_text(content)


def link_to(target):
    return lambda path: Path(path).symlink_to(target)


def hdf5_of_another_program(path):
    with h5py.File(path, "w") as file:
        file["precious"] = range(5)
        file.attrs["format"] = "another"


def test_a_fifo_that_takes_the_name_of_a_file_is_not_waited_for(monkeypatch):
    """Between the look at the file and its opening."""
    Path("a.h5").touch()
    before = os.stat("a.h5")
    os.remove("a.h5")
    os.mkfifo("a.h5")
    writer = os.open("a.h5", os.O_RDWR)
    for close in (lambda: os.close(writer), lambda: None):  # the second time nobody writes
        with monkeypatch.context() as patch, pytest.raises(StoreError, match="is a FIFO"):
            patch.setattr(os, "stat", lambda path: before)
            open_regular(Path("a.h5"))
        close()


SCHEMA = "out.h5.parts/schema.h5"
NO_FOLDER = "out.h5.parts is needed as a folder, but something else has that name"
NO_LOCK = "out.h5.lock is needed as a lock, but something else has that name; move it"
#: Texts that are no lock of this program, though one begins like it.
TEXTS = ("my notes\n", "42\n", "vibroimpact lock of process 1\nand more\n", 100 * "\0")
#: What others have put where a run would write: the name, what it is, and what is said of it.
OTHERS = [
    *((name, os.mkfifo, "not a regular file") for name in ("out.h5", SCHEMA)),
    *((name, text("precious"), "give another output") for name in ("out.h5", SCHEMA)),
    ("out.h5", hdf5_of_another_program, "not one that vibroimpact wrote"),
    *(("out.h5.parts", make, NO_FOLDER) for make in (os.mkfifo, text(""), link_to("folder"))),
    *(("out.h5.lock", make, NO_LOCK) for make in (os.mkfifo, link_to("mine"), link_to("missing"))),
    *(("out.h5.lock", text(content), NO_LOCK) for content in TEXTS),
]


@pytest.mark.parametrize(("name", "make", "said"), OTHERS)
def test_what_others_put_where_a_run_writes_is_refused_and_stays(name, make, said):
    """Without waiting for a writer; for other kinds of files see ``test_replacing.py``."""
    Path(name).parent.mkdir(exist_ok=True)
    Path("folder").mkdir()
    Path("mine").write_text("42\n")
    make(name)
    before = there()
    for option in ("--overwrite", "--resume"):
        result = call("run", "sweep.yaml", "--quiet", option)
        assert result.exit_code == 2 and said in result.stderr
    assert call("info", "out.h5").exit_code == 2
    assert there() == before


def there():
    """Return the kind and the content of all that is in this folder."""
    found = {}
    for path in Path().rglob("*"):
        mode = path.lstat().st_mode
        content = path.read_bytes() if stat.S_ISREG(mode) else None
        found[path] = mode, os.readlink(path) if stat.S_ISLNK(mode) else content
    return found


def test_other_files_in_the_folder_of_the_blocks_stay():
    fill_blocks("out.h5", 2)
    mine = [Path("out.h5.parts") / name for name in ("notes.txt", "block-x.npz", ".new")]
    for path in mine:
        path.touch()
    fill_blocks("out.h5", resume=True)
    assert sorted(Path("out.h5.parts").iterdir()) == sorted(mine)
    open_sweep("out.h5").close()
    fill_blocks("out.h5", 2, overwrite=True)
    fill_blocks("out.h5", 0, overwrite=True)
    assert sorted(os.listdir("out.h5.parts")) == sorted([*(p.name for p in mine), "schema.h5"])


@pytest.mark.parametrize("kept", [0, 2500, -10])
def test_an_empty_or_damaged_file_of_a_sweep_can_be_replaced(finished_file, kept):
    Path("out.h5").write_bytes(finished_file.read_bytes()[:kept])
    fill_blocks("out.h5", overwrite=bool(kept), resume=not kept)
    open_sweep("out.h5").close()


def test_the_ending_of_another_kind_of_file_is_refused():
    """Of pictures, films, tables, texts, arrays and archives; all others may be meant."""
    pictures = (f".{ending}" for ending in FigureCanvasBase.get_supported_filetypes())
    rest = (
        ".PDF .csv .JSON .yaml .yml .txt .npz .npy .mat .parquet .xlsx .tsv .mp4 .md .py .zip .gz"
    )
    for ending in (*pictures, *rest.split()):
        with pytest.raises(StoreError, match=rf"does not end in {ending}; did you mean .*z\.h5\?"):
            check_output(f"z{ending}", overwrite=True)
    with pytest.raises(StoreError, match=r"did you mean z-0\.8\.h5\?"):
        check_output("z-0.8.h5.gz")
    for ending in ("", ".5", ".h5", ".H5", ".hdf5", ".hdf", ".nc", ".v2"):
        check_output(f"z{ending}")


@pytest.mark.parametrize("ending", [".parts", ".lock", ".PARTS"])
def test_the_endings_of_the_files_beside_an_output_are_refused(monkeypatch, ending):
    with pytest.raises(StoreError, match=rf"must not end in {ending}, .* did you mean z\.h5\?"):
        check_output(f"z.h5{ending}")
    fill_blocks("out.h5", 1)
    for name in ("schema.h5", "new.h5"):
        with pytest.raises(StoreError, match=r"that is not complete; give out\.h5$"):
            check_output(f"out.h5.parts/{name}", overwrite=True)
    monkeypatch.chdir("out.h5.parts")
    with pytest.raises(StoreError, match=r"in\.h5 belongs to a sweep .* give /.*out\.h5$"):
        check_output("in.h5")


def test_outputs_that_are_refused(tmp_path):
    check_output("new.h5")
    with pytest.raises(StoreError, match="is a directory"):
        check_output(tmp_path, overwrite=True)
    with pytest.raises(StoreError, match=r"the folder missing of the output new\.h5 does not"):
        check_output("missing/new.h5", overwrite=True)
    with pytest.raises(StoreError, match=r"the folder ~ .*; only a shell replaces ~"):
        check_output("~/new.h5")
    check_output(f"{'x' * 246}.h5")
    with pytest.raises(StoreError, match="File name too long"):  # the name of its folder
        check_output(f"{'x' * 247}.h5")
    Path("link.h5").symlink_to("missing/new.h5")
    said = r"the folder .*missing of the output link\.h5, a link to .*new\.h5, does not exist"
    with pytest.raises(StoreError, match=said):
        check_output("link.h5")


def test_a_sweep_larger_than_the_disk_is_refused(monkeypatch):
    fill_blocks("old.h5", 2)
    part = sum(map(len, contents(Path("old.h5.parts")).values()))
    monkeypatch.setattr("shutil.disk_usage", lambda _: types.SimpleNamespace(free=100_000))
    with pytest.raises(StoreError, match=r"takes about 50 MB .* only 100 kB left; record less, or"):
        check_room(Path("out.h5"), 50_000_000)
    # An existing file frees no space, but the blocks of a resumed sweep already take room.
    with pytest.raises(StoreError, match="only 100 kB left; record less, delete the old file"):
        check_room(Path("old.h5"), 100_001)
    check_room(Path("old.h5"), 100_000)
    check_room(Path("old.h5"), 100_000 + part, resume=True)
    with pytest.raises(StoreError, match="only 100 kB left"):
        check_room(Path("old.h5"), 100_001 + part, resume=True)


def test_files_that_are_not_ours_are_refused(tmp_path):
    with pytest.raises(StoreError, match="does not exist"):
        open_sweep("out.h5")
    for folder in (tmp_path, ".", "/", ""):
        with pytest.raises(StoreError, match="is a directory"):
            open_sweep(folder)
    for name in ("/dev/zero", "a\0b", "x" * 300):
        with pytest.raises(StoreError):
            open_sweep(name)
    Path("out.h5").write_text("name: not HDF5\n")
    with pytest.raises(StoreError, match="is not an HDF5 file"):
        open_sweep("out.h5")
    for name in ("another", 7, np.array([1.0, 2.0]), h5py.Empty("f")):
        with h5py.File("out.h5", "w") as file:
            file.attrs["format"] = name
        with pytest.raises(StoreError, match="not one that vibroimpact wrote"):
            open_sweep("out.h5")
    Path("out.h5").unlink()
    fill_blocks("out.h5")
    with open_sweep("out.h5") as ds:
        ds.to_netcdf("copy.h5", engine="h5netcdf")
    with pytest.raises(StoreError, match=r"copy\.h5 is .*, but not one that vibroimpact wrote"):
        open_sweep("copy.h5")


@pytest.mark.parametrize("name", ["", "/schema.h5", "/block-000001.npz"])
def test_the_folder_of_blocks_is_refused_with_the_name_to_give(name):
    fill_blocks("out.h5", 2)
    with pytest.raises(StoreError, match=r"to a sweep that is not complete; give out\.h5$"):
        open_sweep(f"out.h5.parts{name}")


def test_an_incomplete_sweep_is_read_through_a_link_to_its_output():
    Path("folder").mkdir()
    Path("link.h5").symlink_to("folder/real.h5")
    fill_blocks("link.h5", 2)
    assert Path("folder/real.h5.parts").exists()
    open_sweep("link.h5").close()


@pytest.mark.parametrize("ending", [b"L", b"4"])
def test_files_of_other_versions_are_refused(ending):
    with h5py.File("out.h5", "w") as file:
        file.attrs["format"] = FORMAT
    with Path("out.h5").open("ab") as file:
        file.write(b"\x89VIBRO" + ending + b"\n")
    message = f"not of format version {FORMAT_VERSION}: what is in it cannot be trusted"
    for use in (open_sweep, lambda path: fill_blocks(path, resume=True)):
        with pytest.raises(StoreError, match=message):
            use("out.h5")
    fill_blocks("out.h5", overwrite=True)


def refuse_lock(*_, error=errno.ENOLCK):
    """Stand in for fcntl.flock on a file system without locks."""
    raise OSError(error, os.strerror(error))


#: The same for the code of another process.
WITHOUT_LOCKS = (
    "import os, errno, fcntl\n" + inspect.getsource(refuse_lock) + "fcntl.flock = refuse_lock\n"
)
#: A command that starts another one where process numbers begin anew, as in a container.
CONTAINER = ["unshare", "-U", "--map-root-user", "-p", "-f", "--kill-child", "--mount-proc"]


@contextmanager
def holder(path, first="", launcher=()):
    """Hold the lock of `path` in another process; it prints a line when it has it."""
    code = first + (
        "import sys, time; from pathlib import Path; from sweeps.store.writer import sweep_writer\n"
        "with sweep_writer(Path(sys.argv[1])):\n"
        "    print('held', flush=True); time.sleep(1000)\n"
    )
    environment = {"PYTHONPATH": str(ROOT)}
    command = [*launcher, sys.executable, "-c", code, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        try:
            assert process.stdout.readline() == b"held\n"
            yield process
        finally:
            process.kill()


def test_a_second_writer_is_refused_by_number_and_a_dead_one_is_not():
    Path("link.h5").symlink_to("out.h5")
    with holder("out.h5") as other:
        for name in ("out.h5", "link.h5", "out.h5"):
            with pytest.raises(StoreError, match=f"being written by process {other.pid};"):
                with sweep_writer(Path(name)):
                    pass
    assert Path("out.h5.lock").exists()  # its process was killed
    with sweep_writer(Path("out.h5")):
        assert re.search(rf"process {os.getpid()}\n", Path("out.h5.lock").read_text())
    assert not Path("out.h5.lock").exists()


def test_a_folder_without_room_for_a_lock_is_not_taken_for_another_writer(monkeypatch):
    """On Windows, a folder that refuses new files looks like a lock that another process holds."""

    def refuse(*_, **__):
        raise Timeout("out.h5.lock")

    monkeypatch.setattr(FileLock, "acquire", refuse)
    with pytest.raises(StoreError, match=r"no file can be made in the folder .* of .* out\.h5$"):
        with sweep_writer(Path("out.h5")):
            pass


@pytest.mark.parametrize("text", [b"", bytes(len("vibroimpact lock of process 12345\n"))])
def test_a_lock_that_lost_its_text_with_the_power_is_a_leftover(text):
    fill_blocks("out.h5", 2)
    Path("out.h5.lock").write_bytes(text)
    fill_blocks("out.h5", resume=True)
    assert not Path("out.h5.lock").exists()


@pytest.mark.parametrize("error", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP])
def test_on_a_disk_without_locks_the_file_itself_is_the_lock(monkeypatch, error):
    """A dead process of this machine loses it; a living or a distant one is named."""
    monkeypatch.setattr("fcntl.flock", partial(refuse_lock, error=error))
    monkeypatch.setattr("socket.gethostname", lambda: "n" * 64)  # the longest on Linux
    fill_blocks("out.h5", 2)
    with sweep_writer(Path("out.h5"), resume=True):
        mine = Path("out.h5.lock").read_text()
        with pytest.raises(StoreError, match=rf"process {os.getpid()} on n{{64}}.*, remove"):
            fill_blocks("out.h5", resume=True)
    with subprocess.Popen(["true"]) as ended:
        pass
    number, _, rest = mine.partition("\n")
    assert int(number) == os.getpid()
    Path("out.h5.lock").write_text(f"{ended.pid}\n{rest}")
    fill_blocks("out.h5", resume=True)
    assert set(os.listdir()) == {"sweep.yaml", "out.h5"}
    Path("out.h5.lock").write_text("1\nanother-machine\n")
    with pytest.raises(StoreError, match=r"process 1 on another-machine; wait .*if it has ended"):
        fill_blocks("out.h5", resume=True)


def starts_containers():
    """Whether this user may start a process in other namespaces."""
    with suppress(FileNotFoundError):
        return subprocess.run([*CONTAINER, "true"], capture_output=True).returncode == 0
    return False


@pytest.mark.slow
@pytest.mark.skipif(not starts_containers(), reason="the system starts no containers")
def test_a_lock_of_another_container_is_not_taken_over(monkeypatch):
    """On a disk without locks. No process here has the number of the one that writes there."""
    monkeypatch.setattr("fcntl.flock", refuse_lock)
    with subprocess.Popen(["true"]) as ended:
        pass
    number = f'echo {ended.pid - 1} > /proc/sys/kernel/ns_last_pid; "$@"; true'
    with holder("out.h5", WITHOUT_LOCKS, [*CONTAINER, "sh", "-c", number, "sh"]):
        with pytest.raises(StoreError, match=rf"by process {ended.pid} on .*; wait .*if it has"):
            with sweep_writer(Path("out.h5")):
                pass


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_a_complete_file_is_read_where_no_file_can_be_locked():
    fill_blocks("out.h5")
    code = (
        "from pathlib import Path; from sweeps.store.xarray_engine import open_sweep\n"
        "from sweeps.store.complete_file import per_point, schema_of\n"
        "open_sweep('out.h5').load(); per_point(Path('out.h5'), ['status'])\n"
        "schema_of(Path('out.h5'))"
    )
    without = "-fqq --seccomp-bpf -e trace=flock,fcntl -e inject=flock:error=ENOLCK".split()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    reading = [shutil.which("strace"), *without, "-o", "/dev/null", sys.executable, "-c", code]
    done = subprocess.run(reading, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
