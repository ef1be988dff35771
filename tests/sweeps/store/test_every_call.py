"""Faults at every call of the system: it fails, another program comes between, the power is lost.

A run then ends with an error or with the right data, and costs no finished block; `test_faults.py`
has the faults at chosen moments. Here are the faults at some calls; at all of them:
``pytest -m campaign tests/sweeps/store/test_every_call.py``.
"""

import builtins
import errno
import io
import os
import re
import shutil
from contextlib import contextmanager, suppress
from copy import deepcopy
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sweeps.errors import Failed, StoreError, SweepError
from sweeps.reports import kept_text
from sweeps.store import writer
from sweeps.store.parts import finished_points
from tests.helpers.sweep_files import data
from tests.helpers.written_files import (
    FOUR_BLOCKS,
    begun,
    block_results,
    contents,
    fill_blocks,
)

PARTS = Path("out.h5.parts")


def at_every(step):
    """Return the mark of a test at every call, or at some of them, `step` calls apart."""
    steps = [pytest.param(step, marks=pytest.mark.slow)]
    steps.append(pytest.param(1, marks=pytest.mark.campaign))
    return pytest.mark.parametrize("step", steps, ids=["some", "many"])


@contextmanager
def watched(names, hook):
    """Go through ``hook(name, arguments)``, a generator, around every call of the system.

    `names` are functions of `os`; ``open`` is watched, too. The part before the yield may raise
    an error in place of the call.
    """
    hooked = []

    @contextmanager
    def within():
        hooked.append(None)
        try:
            yield
        finally:
            hooked.pop()

    def around(name, function):
        def call(*arguments, **options):
            if hooked:  # the hook itself calls
                return function(*arguments, **options)
            parts = hook(name, arguments)
            with within():
                next(parts)
            try:
                return function(*arguments, **options)
            finally:
                with within():
                    next(parts, None)

        return call

    with pytest.MonkeyPatch.context() as patch:
        opens = [(module, "open") for module in (io, builtins)]
        for module, name in (*opens, *((os, name) for name in names.split())):
            patch.setattr(module, name, around(name, getattr(module, name)))
        yield


def counting(computed):
    """Return a function for the results of a block that notes which were computed."""

    def results(block):
        computed.append(block)
        return block_results(block)

    return results


# A call fails once, as on a disk of the network. Only the error that says so means that a file is
# missing; any other refuses or ends the run.


@contextmanager
def one_failing(which, error):
    """Let one of the calls that concern the files of the sweep fail; yield the calls made."""
    made = []

    def hook(name, arguments):
        path = arguments[0]
        if not isinstance(path, int) and "out.h5" in os.fspath(path):
            made.append((name, Path(path).name))
            if len(made) == which + 1:
                raise OSError(error, os.strerror(error), os.fspath(path))
        yield

    with watched("stat lstat listdir scandir open", hook):
        yield made


@at_every(8)
def test_whichever_call_fails_a_resumed_run_loses_nothing(step):
    fill_blocks("whole.h5", plan=FOUR_BLOCKS)
    whole = data("whole.h5")
    fill_blocks("out.h5", 2, plan=FOUR_BLOCKS)
    before, which, refused, computed = contents(PARTS), 0, 0, []
    while True:
        with one_failing(which, errno.ESTALE) as made:
            try:
                fill_blocks("out.h5", plan=FOUR_BLOCKS, results=counting(computed), resume=True)
            except SweepError:
                refused += 1
        assert len(computed) <= 2, made[which]
        if Path("out.h5").exists():
            xr.testing.assert_identical(data("out.h5"), whole)
            Path("out.h5").unlink()
            shutil.rmtree(PARTS, ignore_errors=True)
        else:
            assert before.items() <= contents(PARTS).items(), made[which]
        if len(made) <= which:
            break
        shutil.rmtree(PARTS, ignore_errors=True)
        PARTS.mkdir()
        for name, content in before.items():
            (PARTS / name).write_bytes(content)
        computed.clear()
        which += step
    assert refused > 4


@at_every(8)
@pytest.mark.parametrize("blocks", [2, None])
def test_whichever_call_fails_a_reader_sees_all_that_is_there_or_is_refused(blocks, step):
    fill_blocks("out.h5", blocks, plan=FOUR_BLOCKS)
    there, which = data("out.h5"), 0
    counts = finished_points(Path("out.h5"))
    made = [None]
    while len(made) > which:
        with one_failing(which, errno.EIO) as made:
            with suppress(StoreError):
                assert data("out.h5").equals(there)
            with suppress(StoreError):
                assert finished_points(Path("out.h5")) == counts
        which += step
    assert which > 4 and {"stat", "open"} <= {name for name, _ in made}


def test_a_run_that_fails_while_its_blocks_cannot_be_read_does_not_say_that_none_is_kept():
    fill_blocks("out.h5", 4)
    said = r"kept is not known, because .* cannot be read: Input/output error.*; to go on: CMD$"
    texts = []
    for which in range(12):
        with one_failing(which, errno.EIO):
            texts.append(kept_text(Path("out.h5"), "CMD"))
    unknown = [bool(re.search(said, text)) for text in texts]
    assert sum(unknown) > 5
    assert set(np.compress(np.logical_not(unknown), texts)) <= {kept_text(Path("out.h5"), "CMD")}
    Path("out.h5").touch()
    shutil.rmtree(PARTS)
    assert kept_text(Path("out.h5"), "CMD") == "nothing is kept"


# Another program puts something in a place of the run.

#: The places: the pattern of a name that is there, and the name to take if there is none.
PLACES = {
    "out.h5": "out.h5",
    "out.h5.lock": "out.h5.lock",
    ".out.h5.*.new": None,
    "out.h5.parts/schema.h5": None,
    "out.h5.parts/.*.new": None,
    "out.h5.parts/block-*.npz": "out.h5.parts/block-000002.npz",
}
CALLS = "stat lstat fstat listdir scandir open mkdir rmdir link rename replace unlink fsync close"


def intrude(place, link):
    """Put a dangling link or a file in a place, if it is there; return its path."""
    at = max(Path().glob(place), default=PLACES[place] and Path(PLACES[place]))
    if at is None or not at.parent.is_dir():
        return []
    os.symlink("missing", "it") if link else Path("it").write_bytes(b"precious")
    os.replace("it", at)
    return [at]


def intruded(which, late, place, link, **options):
    """Put something in a place just before or after a call of a run; return whether it was made.

    Only between the look at a file and its removal or replacement, nothing can be put there that
    stays; for a draft there is another look in between.
    """
    made, put, held = [], [], []

    def hook(name, arguments):
        made.extend([name] * len(held))
        now = len(made) == which + 1 and bool(held)
        put.extend(intrude(place, link) if now and not late else ())
        yield
        put.extend(intrude(place, link) if now and late else ())

    def checked(*arguments, by=writer.check_parts):
        held[:] = [1]  # what was there before is the old sweep
        by(*arguments)

    with pytest.MonkeyPatch.context() as patch, suppress(StoreError, Failed):
        patch.setattr(writer, "check_parts", checked)
        with watched(CALLS, hook):
            fill_blocks("out.h5", plan=FOUR_BLOCKS, **options)
    about = which, late, place, link, options, made[which : which + 2]
    soon = made[which + late : which + late + 1 + place.endswith(".new")]
    if not {"unlink", "replace"}.intersection(soon):
        for at in put:
            there = os.readlink(at) if link else at.read_bytes().decode()
            assert there == ("missing" if link else "precious"), about
        if Path("out.h5").exists() and put != [Path("out.h5")]:
            assert data("out.h5").sizes["omega"] == 6, about
    assert not Path("missing").exists(), about
    return len(made) > which


SOME = pytest.param(797, slice(None, None, 7), marks=pytest.mark.slow)
ALL = [pytest.param(1, slice(n, n + 1), marks=pytest.mark.campaign) for n in range(30)]


@pytest.mark.parametrize(("step", "cases"), [SOME, *ALL])
@pytest.mark.parametrize("old", [None, 2, 4])
def test_what_another_program_puts_there_stays_and_is_no_result(tmp_path, step, cases, old):
    """In the place of the output, the lock, a draft, the schema or a block, old or new."""
    (tmp_path / "old").mkdir()
    if old is not None:
        fill_blocks("old/out.h5", old, plan=FOUR_BLOCKS)
    number, folder = 0, tmp_path / "new"
    commands = {}, {"resume": True}, {"overwrite": True}
    every = [*product(commands, PLACES, ((False, True), (True, False)))]
    for options, place, (late, link) in every[cases]:
        which = number = (number + 7) % step
        went_on = True
        while went_on:
            shutil.copytree("old", folder)
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                went_on = intruded(which, late, place, link, **options)
            shutil.rmtree(folder)
            which += step


# The power is lost. A file then holds what it had when it was synchronized last. A name in a folder
# may be as it was when the folder was synchronized last, or as at any moment since, whatever the
# other names are.


class Disk:
    """Notes, while a folder is written, what a loss of power may leave of it."""

    def __init__(self, folder):
        self.folder, self.promised = folder, 0
        #: The moments: the number of blocks that must be there, `held` and `names`.
        self.moments = []
        #: The bytes of each file when it was synchronized last; None for a folder.
        self.held = {}
        #: What each name in each folder has been since the folder was synchronized, oldest first.
        self.names = {}
        #: The number of each file, by the one of the system, which may be given to another later.
        self._numbers = {}
        self.note()

    def note(self, synced=None):
        """Note all names; `synced` is the status of the file or folder synchronized just now."""
        folders = [self.folder, *(path for path in self.folder.iterdir() if path.is_dir())]
        paths = {path: path.lstat() for folder in folders for path in (folder, *folder.iterdir())}
        there = {about.st_ino for about in paths.values()}
        self._numbers = {inode: n for inode, n in self._numbers.items() if inode in there}
        for path, about in paths.items():
            if about.st_ino not in self._numbers:
                self._numbers[about.st_ino] = len(self.held)
                self.held[len(self.held)] = None if path.is_dir() else b""
            if synced is not None and about.st_ino == synced.st_ino and not path.is_dir():
                self.held[self._numbers[about.st_ino]] = path.read_bytes()
        for folder in folders:
            inode = paths[folder].st_ino
            past = self.names.setdefault(self._numbers[inode], {})
            for name in {*past, *os.listdir(folder)}:
                about = paths.get(folder / name)
                now = None if about is None else self._numbers[about.st_ino]
                states = past.setdefault(name, [None])
                states += [now] * (now != states[-1])
                if synced is not None and inode == synced.st_ino:
                    past[name] = [now]
        self.moments.append((self.promised, dict(self.held), deepcopy(self.names)))

    def after(self, name, arguments):
        """Note what a call has changed."""
        yield
        self.note(os.fstat(arguments[0]) if name == "fsync" else None)


def left(moment, choose):
    """Return what a loss of power leaves: the bytes of each file by its path, None of a folder.

    `choose` takes a name and its states, and returns one of these.
    """
    _, held, names = moment
    remains = {}

    def descend(number, folder):
        for name, states in names.get(number, {}).items():
            if (file := choose(name, states)) is not None:
                remains[folder / name] = held[file]
                descend(file, folder / name)

    descend(0, Path())
    return remains


def chooses():
    random = np.random.default_rng(1)
    yield "as synchronized", lambda name, states: states[0]
    yield "as written", lambda name, states: states[-1]
    yield "drafts as written", lambda name, states: states[-1 if name.endswith(".new") else 0]
    yield "at random", lambda name, states: states[random.integers(len(states))]


@pytest.fixture
def moments(monkeypatch, tmp_path):
    """The moments of a run of four blocks, which is interrupted after two and resumed."""
    folder, clock = tmp_path / "disk", [0.0]
    folder.mkdir()
    disk = Disk(folder)
    with monkeypatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("time.monotonic", lambda: clock[0])
        with watched("open mkdir rmdir link rename replace unlink fsync", disk.after):
            for count in (2, None):
                with begun("out.h5", FOUR_BLOCKS, resume=True) as (store, pending):
                    for i, block in enumerate(pending[:count], 4 - len(pending)):
                        clock[0] += (0.4, 1.1)[i % 2]
                        store.write(block, block_results(block))
                        if i % 2:  # more than a second after the one before
                            disk.promised = i + 1
                    if count is None:
                        store.finish()
                disk.promised = max(disk.promised, count or 4)
    return disk.moments


@at_every(9)
def test_a_loss_of_power_costs_no_block_of_more_than_a_second_ago(moments, tmp_path, step):
    fill_blocks("whole.h5", plan=FOUR_BLOCKS)
    whole = data("whole.h5")
    tried, computed = set(), []
    for number, moment in enumerate(moments[::step]):
        for how, choose in chooses():
            remains = left(moment, choose)
            if (case := (moment[0], frozenset(remains.items()))) in tried:
                continue
            tried.add(case)
            folder = tmp_path / f"{number} {how}"
            folder.mkdir()
            for path, content in remains.items():
                if content is None:
                    (folder / path).mkdir()
                else:
                    (folder / path).write_bytes(content)
            computed.clear()
            out = folder / "out.h5"
            fill_blocks(out, plan=FOUR_BLOCKS, results=counting(computed), resume=True)
            assert 4 - len(computed) >= moment[0], (number, how)
            xr.testing.assert_identical(data(out), whole)
    assert len(tried) > 12
