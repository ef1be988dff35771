"""The cache of compiled code: never required, never trusted if another user could write."""

import builtins
import io
import itertools
import os
import pickle
import resource
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import filelock
import numba
import pytest

import vibroimpact
from vibroimpact.jit import cache, called_before_passes, overloads, watched
from vibroimpact.jit.cache import CacheWarning
from vibroimpact.jit.overloads import CompiledCode


def call(folder):
    """Compile a function, or read it from the cache; return whether it was read."""

    @numba.njit
    def double(x):
        return x + x

    double._cache = CompiledCode(double.py_func, folder)
    double.compile = double._cache.releasing(double.compile)
    cache.warn_once.cache_clear()
    assert double(21) == 42
    return sum(double.stats.cache_hits.values()) == 1


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("root") / "compiled"
    assert [call(folder), call(folder)] == [False, True]
    return folder


@pytest.fixture
def folder(compiled, tmp_path):
    return shutil.copytree(compiled, tmp_path / "compiled")


def test_a_moved_function_is_not_compiled_anew(tmp_path):
    """Only the computation counts, not the position, comments or docstring."""
    functions = []  # while one lives, numba knows the module that the file lacks

    def result(text):
        (tmp_path / "module.py").write_text(text)
        function = numba.njit(runpy.run_path(str(tmp_path / "module.py"))["scaled"])
        functions.append(function)
        function._cache = CompiledCode(function.py_func, tmp_path / "compiled")
        return function(21), sum(function.stats.cache_hits.values())

    text = "def scaled(x):\n    return 2 * x\n"
    assert [result(text), result(text)] == [(42, 0), (42, 1)]
    assert result('# moved\n\ndef scaled(x):\n    "Twice."\n    return 2 * x  # x + x\n') == (42, 1)
    assert result(text.replace("2", "3")) == (63, 0)


def test_a_damaged_name_of_the_code_is_found_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    package = Path(cache.__file__).parent
    name = cache.numerics_of(package)
    (kept,) = (tmp_path / "numerics").iterdir()
    kept.write_bytes(kept.read_bytes()[:-1] + b"!")
    assert cache.numerics_of(package) == name
    assert name.encode() in kept.read_bytes()


def test_the_folder_and_its_files_are_private(folder):
    assert folder.stat().st_mode & 0o777 == 0o700
    assert [path.stat().st_mode & 0o777 for path in folder.iterdir()] == [0o600]


def changed(path, place):
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


def pipe(path, _):
    path.unlink()
    os.mkfifo(path, 0o600)


@pytest.mark.parametrize(
    ("damage", "at"),
    [(changed, 0), (changed, -1), *((os.truncate, at) for at in (0, 10, 40)), (pipe, 0)],
)
def test_a_damaged_file_is_compiled_anew(folder, damage, at):
    """A changed byte, a cut file, or a pipe in its place, for which nothing waits."""
    (path,) = folder.iterdir()
    damage(path, at)
    assert [call(folder), call(folder)] == [False, True]


class Planted:
    """Creates a file when its pickle is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def plant(folder, trace):
    """Write a file in the format of the cache that executes code if it is read."""
    (path,) = folder.iterdir()
    data = pickle.dumps(Planted(trace))
    path.write_bytes(cache.hashlib.sha256(data).digest() + data)
    return path


def test_a_planted_file_would_be_executed_in_a_private_folder(folder, tmp_path):
    """The effect that the tests below would see."""
    plant(folder, tmp_path / "trace")
    with pytest.warns(CacheWarning, match=r"cannot be read in .* \(TypeError: "):
        assert not call(folder)
    assert (tmp_path / "trace").exists()


def test_a_lack_of_memory_is_not_blamed_on_the_folder(folder, monkeypatch, recwarn):
    def lacking(data):
        raise MemoryError

    monkeypatch.setattr(overloads.pickle, "loads", lacking)
    with pytest.raises(MemoryError):
        call(folder)
    assert not [told for told in recwarn if told.category is CacheWarning]


@pytest.mark.parametrize("which", ["folder", "file", "both"])
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_what_belongs_to_another_user_is_not_executed(folder, tmp_path, which):
    path = plant(folder, tmp_path / "trace")
    for part in {"folder": [folder], "file": [path], "both": [folder, path]}[which]:
        os.chown(part, 65534, 65534)
    if which == "file":  # which is replaced
        assert [call(folder), call(folder)] == [False, True]
    else:
        with pytest.warns(CacheWarning, match="it belongs to another user"):
            assert not call(folder)
    assert not (tmp_path / "trace").exists()


def test_what_others_may_write_to_is_not_executed(folder, tmp_path):
    plant(folder, tmp_path / "trace")
    folder.chmod(0o777)
    with pytest.warns(CacheWarning, match=r"other users may write .* NUMBA_CACHE_DIR"):
        assert not call(folder)
    assert not (tmp_path / "trace").exists()


def test_where_others_may_replace_the_folder_nothing_is_executed(folder, tmp_path):
    """Without the sticky bit, who may write to a folder may rename what is in it."""
    path = plant(folder, tmp_path / "trace")
    for mode in (0o777, 0o770, 0o702):
        tmp_path.chmod(mode)
        with pytest.warns(CacheWarning, match=r"to the folder above .* NUMBA_CACHE_DIR") as told:
            assert not call(folder)
        assert len(told) == 1
    assert not (tmp_path / "trace").exists()
    tmp_path.chmod(0o1777)
    cache.write(path, b"kept")
    assert cache.read(path) == b"kept"


#: Calls of the system that look at a path or use it.
CALLS = {
    os: "open close stat lstat fstat listdir scandir mkdir replace rename unlink",
    builtins: "open",
    io: "open",
}
RENAME = os.rename


def exchanged_at(number, work, place, other):
    """Do a piece of work, and exchange two paths after a call of the system in it.

    Return the result, None after an OSError, and whether the work makes so many calls.
    """
    calls = 0

    def watched(function):
        def watch(*arguments, **options):
            nonlocal calls
            try:
                return function(*arguments, **options)
            finally:
                calls += 1
                if calls == number:
                    RENAME(place, place.with_name("before"))
                    RENAME(other, place)

        return watch

    with pytest.MonkeyPatch.context() as patch:
        for module, names in CALLS.items():
            for name in names.split():
                patch.setattr(module, name, watched(getattr(module, name)))
        try:
            result = work()
        except OSError:
            result = None
    return result, calls >= number


@pytest.fixture
def places(tmp_path):
    """Return a function that makes a folder with a kept file, and a copy of it of another user."""
    if os.geteuid() != 0:
        pytest.skip("only root can give a file away")
    numbers = itertools.count()

    def make(depth, linked):
        """Return the file, and two paths: the file or a folder above it, and what replaces it."""
        new = tmp_path / str(next(numbers))
        path, theirs = new / "root/folder/file", new / "their/folder/file"
        for one, data in ((path, b"ours"), (theirs, b"theirs")):
            cache.write(one, data)
        for one in (theirs, *theirs.parents[:2]):
            os.chown(one, 65534, 65534)
        place, other = ((one, *one.parents)[depth] for one in (path, theirs))
        if linked:
            (new / "link").symlink_to(other)
            other = new / "link"
        return path, place, other

    return make


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("depth", [0, 1, 2], ids=["file", "folder", "root"])
def test_what_another_user_puts_there_meanwhile_is_not_read(places, depth, linked):
    """Its name is exchanged after each call of the system in turn, and back never."""
    number, reached, results = 0, True, set()
    while reached:
        number += 1
        path, place, other = places(depth, linked)
        result, reached = exchanged_at(number, lambda: cache.read(path), place, other)  # noqa: B023
        results.add(result)
    assert number > 3
    assert results <= {b"ours", None} and b"ours" in results


def test_no_file_is_written_or_removed_where_another_user_leads_the_name(places):
    """The oldest of the kept files go, and not those of a folder to which a link leads."""
    number, reached, texts = 0, True, {"a": "1", "b": "2"}
    while reached:
        number += 1
        path, place, other = places(1, True)
        documents = path.parents[2] / "documents"
        documents.mkdir(mode=0o700)
        for name, text in texts.items():
            (documents / name).write_text(text)
        other.unlink()
        other.symlink_to(documents)
        _, reached = exchanged_at(number, lambda: cache.write(path, b"new", 1), place, other)  # noqa: B023
        assert {one.name: one.read_text() for one in documents.iterdir()} == texts
    assert number > 5


def test_a_link_in_place_of_the_folder_is_not_followed(folder, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(folder)
    with pytest.warns(CacheWarning, match="it is not a folder"):
        assert not call(link)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.warns(CacheWarning, match=r"cannot be kept in .*file/compiled \(File exists\)"):
        assert not call(tmp_path / "file/compiled")


@pytest.mark.parametrize("error", [RuntimeError("no home"), None])
def test_no_home_folder(monkeypatch, error):
    """New versions of platformdirs raise this error; older ones return a path with ``~``."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    found = Mock(side_effect=error, return_value="~/.cache/vibroimpact")
    monkeypatch.setattr("platformdirs.user_cache_dir", found)
    with pytest.warns(CacheWarning, match="not absolute.* set NUMBA_CACHE_DIR to a folder"):
        assert not call(cache.cache_folder("private"))
    assert not Path("~").exists()


def test_a_full_disk(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.warns(CacheWarning, match="File too large"):
            assert not call(tmp_path / "compiled")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list((tmp_path / "compiled").iterdir()) == []


def lock_of_another(folder):
    """Remove the only file of a folder, and hold the claim on its code."""
    (path,) = folder.iterdir()
    path.unlink()
    return filelock.FileLock(path.with_suffix(".lock")).acquire().lock


def told_of(folder):
    """Compile, and return what a user is told meanwhile, each thing once."""
    told = []
    with watched(lambda text, _: told.append(text)):
        assert not call(folder)
    return [text.split(",")[0] for text in dict.fromkeys(told)]


def test_a_process_waits_for_another_that_compiles_the_same_but_not_for_ever(folder, monkeypatch):
    monkeypatch.setattr(cache, "LONGEST_WAIT", 0.1)
    lock = lock_of_another(folder)
    assert told_of(folder) == ["waiting for another process", "compiling", ""]
    assert Path(lock.lock_file).exists()  # it is not ours to remove
    lock.release()
    assert call(folder)


def test_without_locks_every_process_compiles(folder, monkeypatch):
    next(folder.iterdir()).unlink()
    monkeypatch.setattr(filelock.FileLock, "acquire", Mock(side_effect=OSError(37, "No locks")))
    assert told_of(folder) == ["compiling", ""]
    assert call(folder)


class EndedError(Exception):
    """Ends the work."""


@pytest.mark.slow
def test_a_wait_and_a_compilation_can_be_ended_and_leave_no_claim(folder):
    lock = lock_of_another(folder)
    with called_before_passes(Mock(side_effect=EndedError)):
        for work in ("wait", "compilation"):
            with pytest.raises(EndedError):
                call(folder)
            if work == "wait":
                lock.release()
                Path(lock.lock_file).unlink(missing_ok=True)
            assert list(folder.iterdir()) == []
    assert [call(folder), call(folder)] == [False, True]


@pytest.mark.slow
def test_an_unusable_cache_leaves_nothing_in_the_package_or_the_temporary_folder(tmp_path):
    package = tmp_path / "site/vibroimpact"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(vibroimpact.__file__).parent, package, ignore=ignored)
    (tmp_path / "temporary").mkdir()
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    code = "from vibroimpact.step.elementary import sin_cos as f; print(f(0.0))"
    environment = {
        "PATH": "",
        "PYTHONPATH": str(package.parent),
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(tmp_path / "file"),
        "TMPDIR": str(tmp_path / "temporary"),
        "HOME": str(tmp_path / "file"),
    }
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0 and result.stderr.count("CacheWarning") == 1, result.stderr
    assert sorted(tmp_path.rglob("*")) == before
