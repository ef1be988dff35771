"""The list of bifurcations: kinds and values, against closed forms, certified and published ones.

All its digits are compared with those of Newton's method on the section map.
"""

import re
import shlex
from dataclasses import fields
from functools import partial

import mpmath as mp
import numpy as np
import pandas as pd
import pytest

import sweeps
from sweeps import branches, open_sweep
from sweeps.bifurcation.bifurcation_table import find_bifurcations
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.opened.result_cache import with_cache
from tests.helpers.commands import accepted, refused
from tests.helpers.oscillators import SectionMap
from tests.helpers.sweep_files import run_in
from vibroimpact import Oscillator, PeriodicOrbit, one_impact_orbits, periodic_orbit

pytestmark = pytest.mark.slow

FILES = {
    "bare": "oscillator: {h: 0.05, R: 0.8, f: 1, omega: [2.6, 2.7]}\nrecord: {diagnostics: []}\n"
}
RECORD = "record: {transient: 400, periods: 64, impacts: 8, diagnostics: [period, lyapunov]}\n"


@pytest.fixture
def sweep(tmp_path):
    """Return a function that runs an oscillator, and returns the path of the file."""

    def run(oscillator, *lines, changes=()):
        config = "\n".join([f"oscillator: {{{oscillator}}}", *lines, RECORD])
        return run_in(tmp_path, config, *changes, overwrite=True)

    return run


#: What is found is kept in a cache, so that a command finds it there.
KEEP = partial(with_cache, say=print)


def bifurcations(path):
    """Return the changes of class, and the other bifurcations of the first branch alone."""
    with open_sweep(path) as dataset:
        return list(find_bifurcations(OpenedSweep(dataset), keep=KEEP, most=1).itertuples())


def test_a_flip_beyond_the_branches_stands_beside_no_line_that_denies_it(sweep):
    """Each flip is found from its own orbit; branches are followed only of few periods."""
    path = sweep("h: 0.02, omega: 2.8, f: 1, R: {start: 0.5617, stop: 0.5623, num: 4}")
    text = accepted("info", path, "--bifurcations")
    assert re.search(r"^0\.56206739267 +flip +16/16 ", text, re.M)
    assert "without an exact branch, of more than 8 periods: 16/16 (" in text
    denied = [line for line in text.splitlines() if line.startswith("not followed")]
    assert not any("16/16" in line for line in denied), denied


@pytest.mark.parametrize(("way", "kind"), [("up", "fold"), ("down", "graze")])
def test_a_fold_and_a_graze_are_told_apart(sweep, way, kind):
    """Swept up, the motion with impacts ends in a fold; swept down, the free one in a graze."""
    graze = np.sqrt(0.995 + np.sqrt(0.995**2 - 1.0 + 1.5**-2))  # where its amplitude is 1.5
    # The last steps are short, so that they do not kick the free motion out of its basin.
    steps = np.linspace(0.02, 0.5, 21) if way == "up" else [-1e-4, *np.geomspace(1e-7, 0.5, 40)]
    common = f"h: 0.05, R: 0.8, clearance: 1.5, f: 1, omega: {(graze + steps).tolist()}"
    rows = bifurcations(sweep(common, f"follow: {{axis: omega, direction: {way}}}"))
    (end,) = (row for row in rows if (str(row.before), str(row.after)) == ("1/1", "1/0"))
    assert end.kind == kind
    assert end.value == pytest.approx(graze if way == "down" else 1.6504, rel=1e-4)


@pytest.mark.parametrize(
    ("R", "clearance", "omega", "kinds"),
    [
        (0.8, 0.0, "{start: 2.6, stop: 2.76, num: 33}", {("flip", "1/1"), ("flip", "2/2")}),
        (0.7, 0.4, "{start: 1.8, stop: 2.0, num: 9}", {("graze", "1/1"), ("fold", "1/1")}),
    ],
)
def test_an_orbit_starts_from_every_row_with_a_value(sweep, R, clearance, omega, kinds):
    """At a flip -1 is a multiplier, at a fold 1; both together are known from the damping."""
    h, phase = 0.1, 0.7
    scene = f"h: {h}, R: {R}, f: 1, clearance: {clearance}, omega: {omega}"
    path = sweep(scene, changes=[f"record.phase={phase}"])
    rows = [*sweeps.bifurcations(path).dropna(subset="value").itertuples()]
    assert {(row.kind, row.orbit) for row in rows} >= kinds
    for row in rows:
        m, q = map(int, row.orbit.split("/"))
        osc = Oscillator(h=h, R=R, f=1.0, clearance=clearance, omega=row.value)
        first, second = row.multiplier_1, row.multiplier_2
        speeds = [float(speed) for speed in row.impact_v.split()]
        assert len(speeds) == q
        if row.kind == "graze":
            assert (first, second) == (np.inf, 0.0) and min(speeds) == 0.0
            continue
        orbit = periodic_orbit(osc, row.x, row.v, m, phase)
        assert orbit.sections(phase)[0] == pytest.approx((row.x, row.v), abs=1e-7)
        assert sorted(orbit.speeds) == pytest.approx(sorted(speeds), abs=1e-7)
        assert first == pytest.approx({"flip": -1.0, "fold": 1.0}[row.kind], abs=1e-9)
        product = R ** (2 * q) * np.exp(-4.0 * np.pi * h * m / osc.omega)
        assert first * second == pytest.approx(product, rel=1e-9)


def test_without_a_value_there_is_no_orbit(sweep):
    """A free motion ends in a graze of 1/0; where rests begin, nothing is known."""
    path = sweep("h: 0.05, R: [0, 0.8], f: 1, omega: {start: 0.5, stop: 3.5, num: 25}")
    found = sweeps.bifurcations(path)
    exact = found["value"].notna()
    assert exact.any() and not exact.all()
    for name in ("x", "v"):
        assert (found[name].notna() == exact).all()
    assert (found.loc[~exact, "impact_v"] == "").all()
    assert found.loc[~exact, ["multiplier_1", "multiplier_2"]].isna().all(axis=None)


def test_the_table_in_python_is_the_one_that_is_listed(sweep):
    """With a certified flip, on one of two lines over R; the axis decreases."""
    path = sweep("h: 0.05, R: [0.2, 0.8], f: 1, omega: [2.7, 2.675, 2.65, 2.625, 2.6]")
    found = sweeps.bifurcations(path)
    columns = ["R", "kind", "value", "low", "high", "before", "after", "between", "orbit"]
    columns += ["source", "x", "v", "impact_v", "multiplier_1", "multiplier_2", "criticality"]
    assert [*found] == columns
    (row,) = found[found["R"] == 0.8].to_dict("records")
    assert row["value"] == pytest.approx(2.65888454668484, rel=1e-12)
    assert (row["kind"], row["before"], row["after"]) == ("flip", "1/1", "2/2")
    assert (row["low"], row["high"], row["criticality"]) == (2.65, 2.675, "supercritical")
    assert found.attrs["axis"] == "omega"
    listed = accepted("info", path, "--bifurcations")
    assert f"{row['value']:.12g}  flip  1/1    {row['before']} -> {row['after']}" in listed


def test_every_bifurcation_is_listed_once_with_both_sides(sweep, tmp_path):
    """Between a graze of the free oscillation and a fold two motions are stable."""
    h, clearance = 0.05, 1.5
    path = sweep(
        f"h: {h}, R: 0.8, clearance: {clearance}, f: 1, omega: {{start: 1.2, stop: 1.7, num: 26}}"
    )
    found = sweeps.bifurcations(path)
    assert found[["kind", "orbit", "before", "after", "source"]].values.tolist() == [
        ["graze", "1/1", "?", "1/0", "exact"],
        ["basin", "", "1/1", "1/0", "bracket"],
        ["fold", "1/1", "1/1", "?", "exact"],
    ]
    graze, _, fold = found["value"]
    assert 1.0 / np.hypot(1.0 - graze**2, 2.0 * h * graze) == pytest.approx(clearance, rel=1e-12)
    existing = [
        len([o for o in one_impact_orbits(
            Oscillator(h=h, R=0.8, omega=omega, f=1.0, clearance=clearance)) if o.exists])
        for omega in (graze - 1e-6, graze + 1e-6, fold - 1e-6, fold + 1e-6)
    ]  # fmt: skip
    assert existing == [1, 2, 2, 0]
    assert (found["low"] <= found["value"].fillna(found["low"])).all()
    assert (found["value"].fillna(found["high"]) <= found["high"]).all()
    accepted("info", path, "--bifurcations", "--csv", tmp_path / "b.csv")
    empty = {name: [""] for name in ("value", "x", "v", "multiplier_1", "multiplier_2")}
    texts = dict.fromkeys(("impact_v", "criticality"), str)
    text = {"keep_default_na": False, "na_values": empty, "dtype": texts}
    written = pd.read_csv(tmp_path / "b.csv", **text)
    pd.testing.assert_frame_equal(written, found, rtol=1e-14)


def test_an_attractor_that_goes_on_is_no_bifurcation(sweep):
    """h = 0.02, R = 0.8: at omega = 1.3 period 1 and the motion 2/3 coexist, both stable."""
    path = sweep("h: 0.02, R: 0.8, f: 1.0, omega: {start: 1.29, stop: 1.32, num: 7}")
    (change,) = (row for row in bifurcations(path) if row.source == "bracket")
    assert (str(change.before), str(change.after)) == ("2/3", "1/1")
    assert change.kind == "basin" and np.isnan(change.value)
    said = accepted("info", path, "--bifurcations")
    assert " basin         2/3 -> 1/1" in said and "basin: the motion of one side is stable" in said
    _, *rows = said.split("\n\n")[0].splitlines()
    lows = [float(row.split(" .. ")[0].split()[-1]) for row in rows]
    assert len(lows) > 1 and lows == sorted(lows)


def test_a_window_behind_chaos_is_no_part_of_the_flip_before_it(sweep):
    """A row for 1/1, which flips at its certified value, and one for the 3/3 window behind."""
    changes = ["record.diagnostics=[period]"]
    path = sweep("h: 0.05, R: 0.8, f: 1.0, omega: [2.6, 3.23, 3.235, 3.32]", changes=changes)
    rows = bifurcations(path)
    (flip,) = (row for row in rows if row.orbit == "1/1")
    (other,) = (row for row in rows if row.high == 3.32 and str(row.after) == "4/3")
    assert (flip.kind, flip.orbit, str(flip.before), str(flip.after)) == ("flip", "1/1", "1/1", "?")
    assert flip.value == pytest.approx(2.65888454668484, rel=1e-12)
    assert (flip.low, flip.high, flip.between) == (2.6, 3.23, 0)
    assert (str(other.before), other.low, other.high) == ("?", 3.235, 3.32)
    assert not other.value <= 3.235


def test_the_arrow_points_where_a_line_was_followed(sweep):
    oscillator = "h: 0, R: 0.8, f: 1, omega: {start: 2.64, stop: 2.73, num: 19}"
    for way, arrow in (("up", "->"), ("down", "<-")):
        path = sweep(oscillator, f"follow: {{axis: omega, direction: {way}}}")
        assert f"1/1 {arrow} 2/2" in (said := accepted("info", path, "--bifurcations"))
        if way == "up":
            flips = "2.65334773, 2.71598725, 2.72911792"
            assert f"cascade: omega = {flips}; ratios of the distances 4.77\n" in said


def test_along_a_start_the_basin_changes(sweep):
    path = sweep("h: 0.02, R: 0.8, f: 1, omega: 1.3", "start: {x0: {start: -2, stop: 0, num: 21}}")
    changes = bifurcations(path)
    assert changes and {change.kind for change in changes} == {"basin"}


def test_the_command_that_is_named_narrows_a_change_without_a_value(folder, unpainted):
    """A motion that rests leaves the stop: no branch of orbits ends there."""
    path = run_in(
        folder,
        "oscillator: {h: 0, R: 0, omega: 1, f: [3.2, 3.3, 3.4], p: 1e-4, clearance: -1e8}\n"
        "start: {x0: -1e8}\nrecord: {transient: 20, periods: 10}\n",
    ).rename("a ball.h5")
    (line,) = (line for line in accepted("info", path, "--bifurcations").splitlines()
               if line.startswith("to narrow"))  # fmt: skip
    said, _, command = line.partition(": vibroimpact ")
    assert said == "to narrow the change without an exact value"
    accepted(*shlex.split(command), "-o", "narrow.h5")
    (change,) = bifurcations("narrow.h5")
    assert change.low <= np.hypot(np.pi, 1.0) <= change.high <= change.low + 0.051


def test_points_without_a_class_beyond_the_last_change_are_counted(sweep):
    chaotic = "h: 0.05, R: 0.8, f: 1.0, omega: [2.6, 2.8, 2.81, 2.82]"
    path = sweep(chaotic, changes=["record.diagnostics=[period]"])
    with open_sweep(path) as dataset:
        assert dataset["period"].values.tolist() == [1, 0, 0, 0]
    said = accepted("info", path, "--bifurcations")
    assert "\nunknown or without a result: 3 points" in said
    assert "Lyapunov exponents tell which are chaotic" in said
    said = accepted("info", sweep(chaotic), "--bifurcations")
    assert " chaotic         1/1 -> chaotic " in said and "unknown" not in said


def test_a_map_is_summed_up_and_its_lines_are_listed(sweep):
    grid = sweep("h: 0.05, R: [0.6, 0.7, 0.8], f: 1.0, omega: {start: 2.4, stop: 3.3, num: 41}")
    lines = accepted("info", grid, "--bifurcations", "--axis", "omega").splitlines()
    assert len(lines) < 45 and lines[0].split() == ["kind", "classes", "times", "omega", "R"]
    assert max(len(word) for line in lines for word in line.split()) <= 10
    flips = [line for line in lines if line.startswith("flip") and "1/1 -> 2/2" in line]
    assert len(flips) == 1
    small = sweep("h: 0.05, R: [0.7, 0.8], f: 1.0, omega: [2.6, 2.7]")
    said = accepted("info", small, "--bifurcations", "--at", "R=0.8")
    row = next(line for line in said.splitlines() if "1/1 -> 2/2" in line)
    assert row.split()[:2] == ["2.65888454668", "flip"]


def test_rests_of_many_periods_are_summed_up_together(sweep):
    chaos = "h: 0.05, R: 0.35, f: 1, clearance: -0.2, omega: {start: 5.4, stop: 5.6, num: 110}"
    said = accepted("info", sweep(chaos, "start: {x0: -0.2}"), "--bifurcations")
    (row,) = (line for line in said.splitlines() if " rest -> rest " in line)
    assert int(row.split()[4]) > 12 and " periods -> rest" not in said


def test_beside_a_flip_what_has_not_settled_is_in_the_bracket(sweep):
    """There a record alternates by less than the tolerance, and less and less."""
    axis = "{start: 2.655, stop: 2.664, num: 46}"
    (flip,) = bifurcations(sweep(f"h: 0.05, R: 0.8, f: 1, omega: {axis}"))
    assert flip.low < flip.value < flip.high
    assert flip.value == pytest.approx(2.65888454668484, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--csv", "b.csv"], "--csv b.csv is not allowed here; expected: with --bifurcations"),
        (["--at", "R=0.8"], "--at R=0.8 is not allowed here; expected: with --bifurcations"),
        (["--axis", "omega"], "--axis omega is not allowed here; expected: with --bifurcations"),
        (["--bifurcations", "--at", "omgea=2"], "omgea cannot be fixed here (did you mean omega?)"),
        (["--bifurcations", "--axis", "h"], "h is not a swept axis"),
        (["--bifurcations"], "record.diagnostics: [period]"),
    ],
)
def test_requests_that_do_not_fit_are_refused(files, arguments, text):
    assert text in refused("info", files / "bare.h5", *arguments)


#: Oscillators, and how many bifurcations of at most 4 periods and 5 impacts each has on its axis.
SCENES = {
    "impact adding": ("h: 0.5, omega: 1, f: 1, R: {start: 0.5, stop: 0.7, num: 21}", 4),
    "two periods": (
        "h: 0.02, R: 0.9, omega: 0.81, clearance: 1, f: {start: 0.343, stop: 0.37, num: 10}", 8
    ),
}  # fmt: skip


@pytest.mark.parametrize("scene", SCENES)
def test_all_twelve_digits_are_those_of_the_section_map(tmp_path, scene):
    oscillator, count = SCENES[scene]
    axis = oscillator.split(": {")[0].split()[-1]
    path = run_in(tmp_path, f"oscillator: {{{oscillator}}}\n{RECORD}", "record.periods=32")
    listed = accepted("info", path, "--bifurcations").split("\n\n")[0].splitlines()[1:]
    printed = {(words[1], words[2], words[0]) for words in map(str.split, listed)}
    with open_sweep(path) as dataset:
        found = KEEP(branches)(dataset, axis)
        fixed = {field.name: dataset[field.name].values.flat[0] for field in fields(Oscillator)}
    compared = set()
    for i, kind in enumerate(found["kind"].values):
        m, q, value = (found[name].values[i] for name in ("m", "q", axis))
        if kind not in ("flip", "fold", "graze") or m > 4 or q > 5:
            continue
        oscillator = Oscillator(**{**fixed, axis: value})
        impacts = (found[f"impact_{name}"].values[i, :q] for name in ("phase", "v"))
        with mp.workdps(50):
            orbit = PeriodicOrbit(oscillator, int(m), *impacts)
            expected = float(SectionMap(orbit).bifurcation(kind, axis))
        compared.add((kind, f"{m}/{q}", f"{expected:.12g}"))
    assert compared <= printed
    assert len(compared) == count


def test_at_a_subcritical_flip_the_arrow_leads_away_from_the_orbit(sweep):
    """On the motion 2/3, followed upwards from its flip: it would jump downwards."""
    scene = "h: 0.05, R: 0.8, clearance: 1.5, f: 1, omega: {start: 0.6235, stop: 0.6255, num: 5}"
    start = ["start.x0=-1.1", "start.v0=0", "follow.axis=omega", "follow.direction=up"]
    found = sweeps.bifurcations(path := sweep(scene, changes=start))
    (flip,) = found[(found["kind"] == "flip") & (found["orbit"] == "2/3")].to_dict("records")
    assert flip["value"] == pytest.approx(0.624320457334, rel=1e-11)
    assert (flip["before"], flip["after"], flip["criticality"]) == ("?", "2/3", "subcritical")
    assert (found.loc[found["kind"] != "flip", "criticality"] == "").all()
    rows = accepted("info", path, "--bifurcations").split("\n")
    (line,) = (row for row in rows if "2/3" in row and "flip" in row)
    assert "? <- 2/3" in line and line.endswith("subcritical")
