"""Exact orbits and least knocks are kept in the cache of the user, and used if all is the same."""

import os
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sweeps import attractors, branches, curves, knocks, open_sweep
from sweeps.attractor.knocks import Knock, _Attractors
from sweeps.bifurcation import bifurcation_table
from sweeps.bifurcation.bifurcation_table import find_bifurcations
from sweeps.opened import result_cache as module
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.opened.result_cache import with_cache
from tests.helpers.commands import accepted
from tests.helpers.sweep_files import run_in, swept
from vibroimpact.jit.cache import write

pytestmark = pytest.mark.slow

FOUND = "what was found before is used again"

SWEEP = """
oscillator: {h: 0.1, R: [0.7, 0.75, 0.8], omega: {start: 2.6, stop: 2.7, num: 9}, f: 1.0}
record: {transient: 200, periods: 16}
"""


@pytest.fixture
def path(folder, path):
    return Path(shutil.copy(path, folder))


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("cache") / "of the user"
    monkeypatch.setattr(module, "root", lambda: folder)
    return folder


class Counted:
    """`branches` or `curves`, with the number of calls that did the work."""

    def __init__(self, find):
        self.find, self.calls, self.__name__ = find, 0, find.__name__

    def __call__(self, *args, **chosen):
        self.calls += 1
        return self.find(*args, **chosen)


def asked(path, find, *args, **chosen):
    """Return what `kept` finds for a file, and what it says."""
    said = []
    with open_sweep(path) as dataset:
        return with_cache(find, said.append)(dataset, *args, **chosen), said


@pytest.mark.parametrize(("find", "axes"), [(branches, "omega"), (curves, ["omega", "R"])])
def test_what_was_found_is_used_again_to_the_last_bit(path, find, axes):
    find = Counted(find)
    first, said = asked(path, find, axes)
    again, then = asked(path, find, axes)
    assert (find.calls, said) == (1, [])
    assert then == [FOUND]
    xr.testing.assert_identical(again, first)
    assert first.sizes["point"] > 10
    assert [again[name].dtype for name in again] == [first[name].dtype for name in first]


def test_another_request_is_answered_for_itself_and_all_are_kept(path):
    find = Counted(branches)
    requests = [({}, {}), ({"R": 0.8}, {}), ({}, {"classes": [(1, 1)]}), ({}, {"most": 3})]
    for calls in (4, 4):
        found = [asked(path, find, "omega", at, **chosen)[0] for at, chosen in requests]
        assert find.calls == calls
        assert float(found[1]["omega"][3]) != float(found[0]["omega"][3])
        assert set(found[2]["m"].values.tolist()) == {1}


def test_nothing_is_used_again_after_a_change_of_the_data_or_of_the_code(path, monkeypatch):
    find = Counted(branches)
    asked(path, find, "omega")
    monkeypatch.setattr(module, "NUMERICS", "other code")
    asked(path, find, "omega")
    assert find.calls == 2
    asked(path, find, "omega")
    assert find.calls == 2
    changed = []
    monkeypatch.setattr(module, "numerics_of", lambda folder: (folder.name, folder.name in changed))
    rooms = None, "bifurcation", "opened", "attractor", "config", None
    for room, calls in zip(rooms, (3, 4, 5, 6, 7, 7), strict=True):
        changed[:] = [room]
        asked(path, find, "omega")
        assert find.calls == calls
    run_in(path.parent, SWEEP.replace("h: 0.1", "h: 0.11"), overwrite=True)
    found, _ = asked(path, find, "omega")
    assert find.calls == 8
    expected = branches(path, "omega")
    np.testing.assert_array_equal(found["omega"], expected["omega"])


def kept_files(cache):
    return sorted((cache / "exact").iterdir())


@pytest.mark.parametrize("damage", ["cut", "byte", "other content", "of others"])
def test_what_is_damaged_or_may_be_of_another_user_is_not_used_but_found_again(path, cache, damage):
    find = Counted(branches)
    first, _ = asked(path, find, "omega")
    (file,) = kept_files(cache)
    whole = file.read_bytes()
    half = len(whole) // 2
    if damage == "other content":  # with a sound checksum
        write(file, b"another")
    elif damage == "of others":
        file.chmod(0o666)
    else:
        changed = whole[:half] + bytes([whole[half] ^ 255]) + whole[half + 1 :]
        file.write_bytes({"cut": whole[:half], "byte": changed}[damage])
    again, said = asked(path, find, "omega")
    assert (find.calls, said) == (2, [])
    xr.testing.assert_identical(again, first)
    assert asked(path, find, "omega")[1] == [FOUND]
    assert file.read_bytes() == whole and file.stat().st_mode & 0o022 == 0


def test_the_oldest_results_go_first(path, cache, monkeypatch):
    monkeypatch.setattr(module, "_MOST", 2)
    find = Counted(lambda dataset, axes, at: xr.Dataset({"x": ("point", [at["R"]])}))
    find.__name__ = "branches"
    for number, calls in ((1, 1), (2, 2), (1, 2), (3, 3), (2, 3), (1, 4)):
        found, _ = asked(path, find, "omega", {"R": number})
        assert found["x"].values == [number] and find.calls == calls
        newest = max(kept_files(cache), key=lambda file: file.stat().st_mtime)
        os.utime(newest, (calls, calls))  # as if the next came later
    assert len(kept_files(cache)) == 2


def with_other_damping(dataset):
    """Change the opened sweep itself: no copy knows of it."""
    dataset["h"] = dataset["h"] + 0.01
    return dataset


CHANGES = {
    "half": lambda dataset: dataset.isel(omega=slice(5)),
    "damping": with_other_damping,
    # As if nothing had settled, beyond the first value.
    "classes": lambda dataset: dataset.assign(
        period=dataset["period"].where(dataset["omega"] < 2.61, 0)
    ),
    "section": lambda dataset: dataset.assign_attrs(
        configuration=dataset.attrs["configuration"].replace("phase: 0.0", "phase: 1.0")
    ),
}


@pytest.mark.parametrize(
    ("find", "change"),
    [(branches, "half"), (branches, "damping"), (branches, "section"), (curves, "classes")],
)
def test_what_was_found_in_a_file_is_not_taken_for_a_changed_sweep(path, find, change):
    axes = ["omega", "R"] if find is curves else "omega"
    whole, _ = asked(path, find, axes)
    with open_sweep(path) as dataset:
        other = CHANGES[change](dataset)
        found = with_cache(find, print)(other, axes)
        xr.testing.assert_identical(found, find(other, axes))
    assert not found.identical(whole)
    again, said = asked(path, find, axes)
    assert said == [FOUND]
    xr.testing.assert_identical(again, whole)


def test_what_is_kept_says_for_what_it_was_found(path, cache):
    """Under the name of another request it is not used."""
    find = Counted(branches)
    first, _ = asked(path, find, "omega")
    (file,) = kept_files(cache)
    asked(path, find, "omega", {"R": 0.8})
    (other,) = set(kept_files(cache)) - {file}
    other.replace(file)
    again, said = asked(path, find, "omega")
    assert (find.calls, said) == (3, [])
    xr.testing.assert_identical(again, first)


def test_a_folder_that_cannot_be_used_is_said(path, cache):
    cache.mkdir()
    (cache / "exact").touch()
    found, said = asked(path, branches, "omega")
    assert found.sizes["point"]
    told = f"what was found is not kept in {cache / 'exact'}: it is not a folder"
    assert said == [told]
    assert accepted("info", path, "--bifurcations", "--at", "R=0.7").count("not kept") == 1


def test_an_incomplete_sweep_keeps_nothing(tmp_path, stop_after):
    with stop_after(1, size=9), pytest.raises(KeyboardInterrupt):
        run_in(tmp_path, SWEEP)
    _, said = asked(tmp_path / "out.h5", branches, "omega")
    assert said == ["what was found is not kept: the sweep is not complete"]


def test_plot_and_info_share_what_was_found(path):
    command = "plot", "out.h5", "--exact", "--dpi", "50", "--at", "R=0.7"
    assert FOUND not in accepted(*command)
    assert FOUND in accepted(*command)
    table = "info", "out.h5", "--bifurcations", "--at", "R=0.7"
    first = accepted(*table)
    assert FOUND in first
    assert accepted(*table) == first


#: Two motions, the free one and one with an impact in two periods.
BASINS = """
oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}
start: {x0: {start: -3.0, stop: 0.6, num: 8}, v0: {start: -3.0, stop: 3.0, num: 11}}
record: {transient: 200, periods: 8, impacts: 4}
"""


def test_knocks_are_computed_once_for_all_pictures_and_tables(tmp_path, no_knocks, unpainted):
    run_in(tmp_path, BASINS)
    picture = "plot", "out.h5", "--kind", "integrity", "--panels", "basins"
    accepted(*picture)
    accepted(*picture)
    assert no_knocks == [0, 1]
    table = "integrity", "out.h5"
    first = accepted(*table)
    assert accepted(*table) == first + "what was found before is used again\n"


def test_knocks_are_not_taken_for_those_of_others(monkeypatch):
    sought = []  # the attractors whose knocks were computed
    monkeypatch.setattr(
        _Attractors,
        "worst",
        lambda _, home, limit: sought.append(home) or Knock(harmful=1.0 + home),
    )
    find, starts = with_cache(knocks), swept(BASINS)
    found = attractors(starts)
    both = find(starts, found)
    xr.testing.assert_identical(find(starts, found), both)
    assert sought == [0, 1]
    alone = find(starts, found, [1])
    assert sought == [0, 1, 1]
    assert np.isnan(alone["knock_harmful"][0]) and alone["knock_harmful"][1] < np.inf
    other = found.assign(number=1 - found["number"])
    xr.testing.assert_identical(find(starts, other), knocks(starts, other))


def test_changes_of_class_are_explained_once_and_the_list_stays_the_same(path, monkeypatch):
    """With all types of its columns; the classes are kept as numbers."""
    keep = partial(with_cache, say=print)
    with open_sweep(path) as dataset:
        first = find_bifurcations(OpenedSweep(dataset), keep=keep)
        monkeypatch.setattr(bifurcation_table, "explain", lambda *_: pytest.fail("again"))
        again = find_bifurcations(OpenedSweep(dataset), keep=keep)
    assert len(first) > 2 and first.attrs == again.attrs
    pd.testing.assert_frame_equal(first, again)


def test_the_states_from_which_crises_are_sought_are_a_part_of_what_is_asked(path):
    said = []
    keep = partial(with_cache, say=said.append)
    changes = FOUND.replace("exact orbits", "changes of class")
    with open_sweep(path) as dataset:
        line = dataset.sel(R=0.8)
        find_bifurcations(OpenedSweep(line), keep=keep, most=1)
        find_bifurcations(OpenedSweep(line), keep=keep, most=2)
        assert said == [changes]
        other = line.assign(poincare_x=line["poincare_x"] + 1e-9)
        find_bifurcations(OpenedSweep(other), keep=keep, most=2)
    assert said == [changes, FOUND]
