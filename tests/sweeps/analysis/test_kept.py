"""Exact branches and curves are kept beside the file of a sweep, and used if all is the same."""

import io

import numpy as np
import pytest
import xarray as xr

from sweeps import branches, curves, open_sweep
from sweeps.analysis import kept as module
from sweeps.analysis.kept import _from_arrays, kept
from sweeps.store.kept import _entries, kept_path
from tests.helpers.commands import accepted
from tests.helpers.sweep_files import run_in

SCENE = """
oscillator: {h: 0.1, R: [0.7, 0.75, 0.8], omega: {start: 2.6, stop: 2.7, num: 9}, f: 1.0}
record: {transient: 200, periods: 16}
"""


@pytest.fixture
def path(tmp_path):
    return run_in(tmp_path, SCENE)


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
        return kept(find, said.append)(dataset, *args, **chosen), said


@pytest.mark.parametrize(
    ("find", "axes"), [(branches, "omega"), (curves, ["omega", "R"])], ids=["branches", "curves"]
)
def test_what_was_found_is_used_again_to_the_last_bit(path, find, axes):
    find = Counted(find)
    first, said = asked(path, find, axes)
    again, then = asked(path, find, axes)
    assert (find.calls, said) == (1, [])
    assert then == [f"the exact orbits are those of {kept_path(path)}"]
    xr.testing.assert_identical(again, first)
    assert first.sizes["point"] > 10
    assert [again[name].dtype for name in again] == [first[name].dtype for name in first]


@pytest.mark.slow
def test_another_request_is_answered_for_itself_and_all_are_kept(path):
    find = Counted(branches)
    requests = [({}, {}), ({"R": 0.8}, {}), ({}, {"classes": [(1, 1)]}), ({}, {"most": 3})]
    for calls in (4, 4):
        found = [asked(path, find, "omega", at, **chosen)[0] for at, chosen in requests]
        assert find.calls == calls
        assert float(found[1]["omega"][3]) != float(found[0]["omega"][3])
        assert set(found[2]["m"].values.tolist()) == {1}


@pytest.mark.slow
def test_nothing_is_used_again_after_a_change_of_the_data_or_of_the_code(path, monkeypatch):
    find = Counted(branches)
    asked(path, find, "omega")
    monkeypatch.setattr(module, "NUMERICS", "other code")
    asked(path, find, "omega")
    assert find.calls == 2
    asked(path, find, "omega")
    assert find.calls == 2
    monkeypatch.setattr(module, "numerics_of", lambda folder: f"other code of {folder}")
    asked(path, find, "omega")
    assert find.calls == 3
    run_in(path.parent, SCENE.replace("h: 0.1", "h: 0.11"), overwrite=True)
    found, _ = asked(path, find, "omega")
    assert find.calls == 4
    expected = branches(path, "omega")
    np.testing.assert_array_equal(found["omega"], expected["omega"])
    with np.load(kept_path(path)) as held:
        assert len(held["vibroimpact_keys"]) == 1  # what is never used again is not kept


def archive(**arrays):
    """Return the bytes of an archive that NumPy writes."""
    image = io.BytesIO()
    np.savez(image, **arrays)
    return image.getvalue()


TEXTS = np.array(["a", "b"])


@pytest.mark.parametrize(
    "content",
    [
        b"a text",
        b"PK\x03\x04" + bytes(100),
        bytes(100) + b"a text",
        archive(keys=np.arange(5)),
        archive(keys=TEXTS),
        archive(keys=TEXTS, values=np.arange(2)),
        archive(keys=TEXTS, values=np.arange(2))[:-9],
    ],
    ids=["text", "zip", "zeros first", "numbers", "texts", "texts and numbers", "cut"],
)
def test_a_foreign_file_is_left_alone(path, content):
    find = Counted(branches)
    asked(path, find, "omega")
    beside = kept_path(path)
    beside.write_bytes(content)
    before = beside.read_bytes()
    _, said = asked(path, find, "omega")
    assert find.calls == 2
    assert said == [
        f"the exact orbits are not kept: {beside.name} is another file, and is left alone"
    ]
    assert beside.read_bytes() == before


@pytest.mark.parametrize("damage", ["cut", "byte", "empty", "zeros"])
def test_a_damaged_file_is_not_used_but_replaced_and_that_is_said(path, damage):
    find = Counted(branches)
    first, _ = asked(path, find, "omega")
    beside = kept_path(path)
    whole = beside.read_bytes()
    half = len(whole) // 2
    images = {
        "cut": whole[:half],
        "byte": whole[:half] + bytes([whole[half] ^ 255]) + whole[half + 1 :],
        "empty": b"",
        "zeros": bytes(len(whole)),
    }
    beside.write_bytes(images[damage])
    again, said = asked(path, find, "omega")
    assert said == [f"{beside} was damaged, and is replaced"]
    xr.testing.assert_identical(again, first)
    assert asked(path, find, "omega")[1] == [f"the exact orbits are those of {beside}"]
    assert find.calls == 2


@pytest.mark.slow
def test_a_flipped_bit_is_never_used(path):
    """NumPy alone takes some of them for other values, and raises errors of a dozen kinds."""
    first, _ = asked(path, branches, "omega")
    beside = kept_path(path)
    whole = beside.read_bytes()
    for place in np.linspace(0, 8 * len(whole) - 1, 1200).astype(int).tolist():
        image = bytearray(whole)
        image[place // 8] ^= 1 << place % 8
        beside.write_bytes(image)
        for arrays in (_entries(path) or {}).values():
            xr.testing.assert_identical(_from_arrays(dict(arrays)), first)


@pytest.mark.slow
def test_what_is_found_for_an_opened_file_is_not_taken_for_that_of_its_successor(path):
    with open_sweep(path) as before:
        before.load()
        run_in(path.parent, SCENE.replace("h: 0.1", "h: 0.11"), overwrite=True)
        kept(branches, print)(before, "omega", classes=[(np.int64(1), np.int64(1))])
    found, _ = asked(path, branches, "omega", classes=[(1, 1)])
    xr.testing.assert_identical(found, branches(path, "omega", classes=[(1, 1)]))


def test_a_folder_that_cannot_be_written_is_said(path, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("sweeps.store.kept.writing", refuse)
    found, said = asked(path, branches, "omega")
    assert found.sizes["point"] and "Permission denied" in said[0]
    assert not kept_path(path).exists()


def test_an_incomplete_sweep_keeps_nothing(tmp_path, stop_after):
    with stop_after(1, size=9), pytest.raises(KeyboardInterrupt):
        run_in(tmp_path, SCENE)
    _, said = asked(tmp_path / "out.h5", branches, "omega")
    assert said == ["the exact orbits are not kept: the sweep is not complete"]


@pytest.mark.slow
def test_plot_and_info_share_what_was_found(path):
    command = "plot", "out.h5", "--kind", "bifurcation", "--exact", "--dpi", "50"
    assert "those of" not in accepted(*command)
    assert "the exact orbits are those of" in accepted(*command)
    table = "info", "out.h5", "--bifurcations", "--at", "R=0.7"
    first = accepted(*table).strip()
    note = "the exact orbits are those of"
    assert note in (again := accepted(*table)) and again.split(note)[0].strip() in first
