"""`vibroimpact compare`: what differs, at how many points, where first and by how much."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from sweeps import open_sweep
from sweeps.opened.comparison import differences
from sweeps.store.complete_file import _add_table
from sweeps.store.variables import VARIABLES
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.sweep_files import run_in
from vibroimpact.status import Status

RIG = """\
rig: {mass: 2.0, stiffness: 800.0, damping: 1.2, force: 10.0, gap: 0.0005, R: 0.8,
      frequency: {start: 2.0, stop: 4.0, num: 3}}
record: {transient: 3, periods: 4, impacts: 2}
"""


@pytest.fixture
def changed(small_file):
    """Return a function that writes a copy of small.h5 in which values were changed."""

    def change(values, name="other.h5"):
        data = Path("small.h5").read_bytes()
        Path(name).write_bytes(data)
        with h5py.File(name, "r+") as file:
            for variable, places in values.items():
                for place, value in places.items():
                    file[variable][place] = value
            held = [one for one in VARIABLES if one in file]
        with open(name, "r+b") as file:
            _add_table(file, held)
        return name

    return change


def lines_of(result):
    assert result.exit_code == 1, result.output
    *lines, last = result.stdout.splitlines()
    assert last.startswith("small.h5 and ") and " differ" in last
    return dict(line.split(": ", 1) for line in lines)


def test_a_file_equals_itself_and_another_run(small_file, folder):
    assert "are equal: " in accepted("compare", "small.h5", "small.h5")
    run_in(folder, SMALL, name="again.h5")
    assert "small.h5 and again.h5 are equal: " in accepted("compare", "small.h5", "again.h5")


def test_what_differs_where_and_by_how_much(changed, monkeypatch):
    """In whatever parts it is read; no variable is kept in memory."""
    with open_sweep("small.h5") as data:
        x, omega = data["poincare_x"].values, data["omega"].values
        assert data["poincare_x"].dims == ("omega", "clearance", "section")
    new = {(1, 1, 2): x[1, 1, 2] + 0.25, (1, 1, 3): np.nan, (4, 0, 0): x[4, 0, 0] - 0.5}
    name = changed({"poincare_x": new})
    whole = call("compare", "small.h5", name)
    found = lines_of(whole)
    assert list(found) == ["poincare_x"]
    text = found["poincare_x"]
    assert text.startswith("differs at 2 of 10 points (3 of 40 values), first at ")
    assert f"omega = {omega[1]:.12g}, clearance = 0.1, section = 6: " in text
    assert text.endswith("; greatest difference 0.5")
    for most in (1, 9, 17):
        monkeypatch.setattr("sweeps.opened.coordinates._VALUES_READ", most)
        assert call("compare", "small.h5", name).stdout == whole.stdout
    with open_sweep("small.h5") as one, open_sweep(name) as other:
        assert [each.name for each in differences(one, other) if each.values] == ["poincare_x"]
        for data in (one, other):
            assert not any(data[name].variable._in_memory for name in data.data_vars)


def test_a_relative_difference_is_allowed_in_numbers_alone(changed):
    with open_sweep("small.h5") as data:
        x = float(data["poincare_x"][3, 1, 1])
    name = changed({"poincare_x": {(3, 1, 1): x * (1.0 + 1e-7)}})
    said = accepted("compare", "small.h5", name, "--rtol", "2e-7")
    assert "are equal to 2e-07 of each value" in said
    assert "poincare_x" in lines_of(call("compare", "small.h5", name, "--rtol", "0.5e-7"))
    assert "poincare_x" in lines_of(call("compare", "small.h5", name))
    name = changed({"poincare_x": {(3, 1, 1): np.inf}, "near_grazes": {(0, 0): 1_000_000}})
    found = lines_of(call("compare", "small.h5", name, "--rtol", "0.9"))
    assert set(found) == {"poincare_x", "near_grazes"}
    one = {"near_grazes": {(0, 0): 1_000_001}, "impact_phase": {(0, 0, 0): 1e-12}}
    changed({**one, "near_grazes": {(0, 0): 1_000_000}}, "small.h5")
    one["impact_phase"] = {(0, 0, 0): 2.0 * np.pi - 1e-12}
    found = lines_of(call("compare", "small.h5", changed(one), "--rtol", "1e-9"))
    assert set(found) == {"near_grazes"}  # a phase just before a full turn is one just after it


def test_an_absolute_difference_is_allowed_in_numbers_alone(changed):
    with open_sweep("small.h5") as data:
        x = float(data["poincare_x"][3, 1, 1])
    name = changed({"poincare_x": {(3, 1, 1): x + 1e-6}})
    told = accepted("compare", "small.h5", name, "--atol", "1.1e-6")
    assert "are equal to 1.1e-06: " in told
    assert "poincare_x" in lines_of(call("compare", "small.h5", name, "--atol", "0.9e-6"))
    both = ("--atol", "0.9e-6", "--rtol", f"{0.2e-6 / abs(x):.3g}")
    assert "of each value and 9e-07: " in accepted("compare", "small.h5", name, *both)
    name = changed({"near_grazes": {(0, 0): 1_000_000}})
    assert set(lines_of(call("compare", "small.h5", name, "--atol", "1e9"))) == {"near_grazes"}


def test_a_changed_key_has_a_line_and_what_follows_another(folder, small_file):
    run_in(folder, SMALL, "record.transient=9", name="other.h5")
    key, follows, last = call("compare", "small.h5", "other.h5").stdout.splitlines()
    assert key == "record.transient: 3 and 9" and last == "small.h5 and other.h5 differ"
    assert follows.startswith("poincare_x: differs at 10 of 10 points (")
    assert "; so do section, " in follows and "poincare_v" in follows
    run_in(folder, SMALL, "oscillator.R=0.7", "method.impact=plain", name="two.h5")
    lines = call("compare", "small.h5", "two.h5").stdout.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["method.impact", "oscillator.R"]
    assert len(lines) == 4 and "; so do " in lines[2]
    lines = call("compare", "small.h5", "two.h5", "--rtol", "1e-9").stdout.splitlines()
    assert len(lines) > 6  # with a tolerance, every variable is measured


def test_coordinates_and_flags_are_compared(changed):
    name = changed({"omega": {2: 2.3}, "h": {(): 0.2}, "status": {(4, 1): int(Status.COMPUTED)}})
    found = lines_of(call("compare", "small.h5", name))
    assert set(found) == {"omega", "h", "status"}
    said = "1 of 5 values differ, first at number 3: 2.25 and 2.3; greatest difference 0.05"
    assert found["omega"] == said
    assert found["h"].startswith("differs: 0.1 and 0.2")
    assert found["status"].endswith(": certified and computed")


def test_a_variable_of_one_file_alone(folder, small_file):
    run_in(folder, SMALL, "record.diagnostics=[period, lyapunov]", name="more.h5")
    found = lines_of(call("compare", "small.h5", "more.h5"))
    assert found["lyapunov"] == "only in more.h5"
    found = call("compare", "more.h5", "small.h5")
    assert found.exit_code == 1 and "lyapunov: only in more.h5\n" in found.stdout


def test_the_order_of_the_axes_does_not_count(folder):
    for name, axes in (
        ("a", "R: [0.7, 0.8], omega: [2, 3, 4]"),
        ("b", "omega: [2, 3, 4], R: [0.7, 0.8]"),
    ):
        text = f"oscillator: {{h: 0.1, f: 1, {axes}}}\nrecord: {{transient: 3, periods: 4}}\n"
        run_in(folder, text, name=f"{name}.h5")
    assert "are equal" in accepted("compare", "a.h5", "b.h5")


def test_tables_directions_and_rigs(folder):
    table = "points: {omega: [2.0, 2.5], serial: [%s]}\noscillator: {h: 0.1, R: 0.8, f: 1}\n"
    for name, serial in (("a", "k1, k2"), ("b", "k1, k3"), ("c", "7, 8")):
        run_in(folder, table % serial, "record.transient=3", "record.periods=4", name=f"{name}.h5")
    found = call("compare", "a.h5", "b.h5")
    assert (found.exit_code, found.stdout.splitlines()[0]) == (
        1, "serial: 1 of 2 values differ, first at point = 2: k2 and k3"
    )  # fmt: skip
    assert "serial: 2 of 2 values differ" in call("compare", "a.h5", "c.h5").stdout
    for name, frequency in (("r", ""), ("s", "rig.damping=1.3")):
        run_in(folder, RIG, *([frequency] if frequency else []), name=f"{name}.h5")
    found = call("compare", "r.h5", "s.h5")
    assert found.exit_code == 1 and "first at frequency = 2, section = 4: " in found.stdout
    rows = "rig: {mass: 2, stiffness: 800, damping: 4, R: 0.7, force: 10, gap: 0.01}\n"
    for name, last in (("t", 5), ("u", 5.5)):
        columns = f"points: {{frequency: [4, {last}]}}\n"
        run_in(folder, rows + columns + "record: {transient: 3, periods: 4}", name=f"{name}.h5")
    said = call("compare", "t.h5", "u.h5").stdout  # of the column, and not of omega, which it gives
    assert said.count("frequency: ") == 1 and "first at point = 2: 5 and 5.5;" in said
    both = "follow: {axis: omega, direction: both}\n"
    run_in(folder, SMALL + both, name="both.h5")
    assert "are equal" in accepted("compare", "both.h5", "both.h5")


def test_trajectories_of_other_lengths(folder):
    scene = SMALL.replace("impacts: 2", "impacts: 2, trajectory: {every: 4}")
    for name, impacts in (("a", []), ("b", ["oscillator.R=0.5"])):
        run_in(folder, scene, *impacts, name=f"{name}.h5")
    with open_sweep("a.h5") as one, open_sweep("b.h5") as other:
        sizes = [data.sizes["sample"] for data in (one, other)]
    assert sizes[0] != sizes[1]
    found = call("compare", "a.h5", "b.h5")
    assert found.exit_code == 1
    assert f"the longest trajectory has {sizes[0]} and {sizes[1]} samples" in found.stdout


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["small.h5", "missing.h5"], ["missing.h5 does not exist"]),
        (["small.h5"], ["OTHER.h5"]),
        (["small.h5", "small.h5", "--rtol", "-1"], ["--rtol -1 ", "a number from 0 to below 1"]),
        (["small.h5", "small.h5", "--rtol", "x"], ["--rtol x ", "a number from 0 to below 1"]),
        (["small.h5", "small.h5", "--atol", "-1"], ["--atol -1 ", "a number from 0"]),
        (["small.h5", "small.h5", "--tol", "1"], ["--tol", "did you mean --rtol or --atol"]),
    ],
)
def test_a_wrong_request_is_refused(small_file, arguments, parts):
    Path("sweep.txt").write_text("hello")
    message = refused("compare", *arguments)
    assert all(part in message for part in parts), message


def test_another_shape_is_refused(folder, small_file):
    run_in(folder, SMALL, "oscillator.omega.num=6", name="other.h5")
    message = refused("compare", "small.h5", "other.h5")
    assert "omega: 5, clearance: 2 and omega: 6, clearance: 2" in message
    run_in(folder, SMALL, "record.impacts=3", name="wider.h5")
    assert "impact: 2 and impact: 3" in refused("compare", "small.h5", "wider.h5")
    run_in(folder, SMALL, "oscillator.omega=2", "oscillator.clearance=0", name="one.h5")
    assert "a single point" in refused("compare", "one.h5", "small.h5")
