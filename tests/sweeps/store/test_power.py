"""A loss of power at any moment of a run: what must be on the disk by then, and what may be.

A file holds what it had when it was synchronized last. A name in a folder may be as it was when the
folder was synchronized last, or as at any moment since, whatever the other names are.
"""

import io
import os
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.helpers.sweep_files import data
from tests.helpers.written_files import FOUR_BLOCKS, begun, block_results, fill_blocks

#: The calls that change names or synchronize; each is a moment at which the power may be lost.
CALLS = {
    os: ("open", "mkdir", "rmdir", "link", "rename", "replace", "unlink", "fsync"),
    io: ("open",),
}


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

    def watch(self, monkeypatch):
        """Note every call from now on."""
        for module, names in CALLS.items():
            for name in names:
                monkeypatch.setattr(module, name, self._noted(name, getattr(module, name)))

    def _noted(self, name, function):
        def call(*arguments, **options):
            result = function(*arguments, **options)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(io, "open", OPEN)
                self.note(os.fstat(arguments[0]) if name == "fsync" else None)
            return result

        return call


OPEN = io.open


def left(moment, choose):
    """Return what a loss of power leaves: the bytes of each file by its path, None of a folder.

    `choose` takes a name and its states, and returns one of these.
    """
    _, held, names = moment
    found = {}

    def descend(number, folder):
        for name, states in names.get(number, {}).items():
            if (file := choose(name, states)) is not None:
                found[folder / name] = held[file]
                descend(file, folder / name)

    descend(0, Path())
    return found


def chooses():
    random = np.random.default_rng(1)
    yield "as synchronized", lambda name, states: states[0]
    yield "as written", lambda name, states: states[-1]
    yield "drafts as written", lambda name, states: states[-1 if name.endswith(".new") else 0]
    for case in range(2):
        yield f"random {case}", lambda name, states: states[random.integers(len(states))]


@pytest.fixture
def moments(monkeypatch, tmp_path):
    """The moments of a run of four blocks, which is interrupted after two and resumed."""
    folder, clock = tmp_path / "disk", [0.0]
    folder.mkdir()
    with monkeypatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("time.monotonic", lambda: clock[0])
        disk = Disk(folder)
        disk.watch(patch)
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


@pytest.mark.slow
def test_a_loss_of_power_at_any_moment_costs_no_block_of_more_than_a_second_ago(moments, tmp_path):
    fill_blocks("whole.h5", plan=FOUR_BLOCKS)
    whole = data("whole.h5")
    tried = set()
    for number, moment in enumerate(moments):
        for how, choose in chooses():
            found = left(moment, choose)
            if (case := (moment[0], frozenset(found.items()))) in tried:
                continue
            tried.add(case)
            folder = tmp_path / f"{number} {how}"
            folder.mkdir()
            for path, content in found.items():
                if content is None:
                    (folder / path).mkdir()
                else:
                    (folder / path).write_bytes(content)
            assert 4 - computed_after(folder) >= moment[0], (number, how)
            xr.testing.assert_identical(data(folder / "out.h5"), whole)
    assert len(tried) > 40


def computed_after(folder):
    """Resume the run in a folder; return the number of blocks that it had to compute."""
    computed = []

    def counted(block):
        computed.append(block)
        return block_results(block)

    fill_blocks(folder / "out.h5", plan=FOUR_BLOCKS, results=counted, resume=True)
    return len(computed)
