"""Requests for exact branches and curves: all sorts of files, and invalid requests."""

import csv
import re

import numpy as np
import pytest

from sweeps import bifurcations, branches, curves, open_sweep
from sweeps.errors import Refused
from tests.helpers.commands import accepted, call, refused
from vibroimpact.status import Status

RECORD = "record: {transient: 200, periods: 32, impacts: 8, diagnostics: [period]}"
MAP = "oscillator: {h: 0.02, R: [0.5, 0.7, 0.9], omega: {start: 2.6, stop: 2.8, num: 9}, f: 1.0}\n"
LINE = "oscillator: {h: 0.05, R: 0.8, omega: {start: 2.6, stop: 2.7, num: 5}, f: 1}\n"
BOTH = "follow: {axis: omega, direction: both}\n"
FILES = {
    "map": MAP + RECORD,
    "line": LINE + RECORD,
    "both": LINE + BOTH + RECORD,
    "map both": MAP + BOTH + RECORD,
    "no period": MAP + RECORD.replace("[period]", "[]"),
    "failed": "oscillator: {h: 0, R: 1, omega: [1.99999, 2, 2.00001], f: [1.0e+307, 2.0e+307]}\n"
    + RECORD,
    "at rest": "oscillator: {h: 0, R: [0.1, 0.2], omega: [0.3, 0.4, 0.5], f: 1.0}\n" + RECORD,
    "single value": "oscillator: {h: 0.05, R: [0.7, 0.8], omega: [2.6], f: 1.0}\n" + RECORD,
    "point": "oscillator: {h: 0.05, R: 0.8, omega: 2.6, f: 1.0}\n" + RECORD,
}
FLIP = 2.65888454668484


@pytest.fixture
def file(files):
    """Return a function of the name of a file that returns its path."""
    return lambda name: files / f"{name}.h5"


@pytest.mark.parametrize(
    ("name", "axes", "message"),
    [
        ("map", ["omega"], "curves are over two swept axes, not omega alone"),
        ("map", "omega", "curves are over two swept axes, not omega alone"),
        ("map", ["h", "R"], "h is not a swept axis; the file has R, omega"),
        ("map", ["R", "R"], "a map has 2 swept axes, not R, R"),
        ("line", [], "a map has 2 swept axes; the file has only omega"),
        ("point", [], "the file holds a single point"),
        ("no period", [], "the file has no period: run the sweep again with record.diagnostics"),
        ("single value", [], "omega has the single value 2.6: exact orbits are followed over a"),
    ],
)
def test_what_has_no_curves_is_refused(file, name, axes, message):
    with open_sweep(file(name)) as dataset, pytest.raises(Refused, match=re.escape(message)):
        curves(dataset, axes)


@pytest.mark.parametrize(
    ("name", "axis", "at", "message"),
    [
        ("map", "omega", {"omega": 2.7}, "omega cannot be fixed here: all its values are used; "),
        ("line", "omega", {"direction": "up"}, "the sweep was not followed in both"),
        ("both", "omega", {"direction": "dwn"}, "there is no direction dwn (did you mean down?)"),
    ],
)
def test_what_has_no_branches_is_refused(file, name, axis, at, message):
    with open_sweep(file(name)) as dataset, pytest.raises(Refused, match=re.escape(message)):
        branches(dataset, axis, at)


def test_an_axis_that_repeats_one_value_is_no_line(file):
    with open_sweep(file("line")) as dataset:
        alike = dataset.isel(omega=[0, 0])
        assert bifurcations(alike).empty
        with pytest.raises(Refused, match="omega has the single value"):
            branches(alike)


@pytest.mark.parametrize("name", ["failed", "at rest"])
def test_where_nothing_is_periodic_there_is_nothing(file, name):
    with open_sweep(file(name)) as dataset:
        status = [Status(value) for value in np.unique(dataset["status"])]
        assert {value.failed for value in status} == {name == "failed"}
        lines, borders = branches(dataset), curves(dataset)
    empty = dict.fromkeys(("point", "impact", "section"), 0)
    assert dict(lines.sizes) == {**empty, "multiplier": 2}
    assert borders.sizes["point"] == borders.attrs["changes"] == 0
    said = "0 exact curves: none\nthere is no change between periodic classes"
    assert borders.attrs["summary"] == said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("failed", "map", "0 exact curves: none"),
        ("failed", "bifurcation", "no point has a result: a number overflow"),
        ("at rest", "map", "0 exact curves: none"),
        ("at rest", "bifurcation", "no exact branch is found"),
        ("single value", "map", "omega has the single value 2.6"),
        ("single value", "bifurcation", "omega has the single value 2.6"),
    ],
)
def test_a_picture_of_nothing_is_drawn_or_refused(file, name, kind, message, tmp_path):
    axes = ["--axis", "omega"] if kind == "bifurcation" else []
    table, picture = tmp_path / "a.csv", tmp_path / "a.png"
    files = "-o", picture, "--csv", table
    result = call("plot", file(name), "--kind", kind, "--exact", *files, *axes)
    assert message in result.output
    drawn = result.exit_code == 0
    assert drawn == (message.endswith(("none", "found")))
    assert table.exists() == picture.exists() == drawn
    assert not drawn or table.read_text().count("\n") == 1


@pytest.mark.parametrize("name", ["failed", "at rest", "single value"])
def test_where_no_class_changes_that_is_listed(file, name, tmp_path):
    table = tmp_path / "a.csv"
    said = accepted("info", file(name), "--bifurcations", "--axis", "omega", "--csv", table)
    assert said.startswith("the class of the motion does not change along omega\n")
    assert table.read_text().count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["both", "map both"])
def test_the_flips_of_both_directions_are_listed_and_drawn(file, name, tmp_path):
    """They are equal; that of R = .8 is certified."""
    table = tmp_path / "a.csv"
    accepted("info", file(name), "--bifurcations", "--csv", table)
    with table.open() as rows:
        flips = [row for row in csv.DictReader(rows) if row["after"] == "2/2"]
    assert {row["direction"] for row in flips} == {"up", "down"}
    values = {}
    for row in flips:
        values.setdefault(row.get("R"), []).append(float(row["value"]))
    assert all(len(same) == 2 and np.ptp(same) < 1e-13 for same in values.values())
    if name == "both":
        assert values[None] == pytest.approx([FLIP, FLIP], rel=1e-13)
        way = "--exact", "--at", "direction=down"
        drawn = accepted("plot", file(name), "-o", "a.png", *way, "--csv", table)
        assert "exact branches of 1/1, 2/2\n" in drawn


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("a.txt", "--csv a.txt is not allowed; expected: a .csv file"),
        ("missing/a.csv", "the folder missing of the table a.csv does not exist"),
    ],
)
@pytest.mark.parametrize("command", [("plot", "--exact"), ("info", "--bifurcations")])
def test_a_bad_table_is_refused_before_the_work(file, name, reason, command):
    result = call(command[0], file("line"), command[1], "--csv", name)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"vibroimpact: error: {reason}\n"


@pytest.mark.slow
def test_a_map_has_no_number_of_branches(file, tmp_path, unpainted):
    options = "--kind", "map", "--exact", "--most", "2", "-o", tmp_path / "map.png"
    assert refused("plot", file("map"), *options).endswith(
        ": --most 2 limits exact branches, and a map shows curves; expected: --exact, with or "
        "without --classes\n"
    )
    drawn = "--kind", "map", "--exact", "--classes", "7/7", "-o", tmp_path / "map.png"
    assert "no curve of 7/7 is found" in accepted("plot", file("map"), *drawn)
