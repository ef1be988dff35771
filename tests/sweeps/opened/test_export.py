"""Tables as files: a table of points against the arrays, written whole or not at all."""

import csv
import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from sweeps import load_config, open_sweep, run_sweep
from sweeps.errors import Failed
from sweeps.opened.export import write_csv
from tests.helpers.commands import accepted, call, refused
from tests.helpers.rigs import rig
from vibroimpact.status import Evidence, Status

CONFIG = """\
oscillator: {h: 0.1, R: [0.5, 0.8], omega: {start: 1.0, stop: 3.0, num: 7}, f: 1.0}
record: {transient: 20, periods: 8, impacts: 4, diagnostics: [period, lyapunov, extremes]}
"""


class Failing:
    def __str__(self):
        raise OSError(28, "No space left on device")


def test_a_table_is_written_whole_or_not_at_all():
    """A failure leaves the old file and no other."""
    path = Path("a.csv")
    write_csv(path, [pd.DataFrame([[1, 2.5], ["x, y", ""]], columns=["a", "b"])])
    assert path.read_bytes() == b'a,b\n1,2.5\n"x, y",\n'
    with pytest.raises(Failed, match=r"a\.csv cannot be written: No space"):
        write_csv(path, [pd.DataFrame({"a": [1, Failing()], "b": 2})])
    assert path.read_bytes().startswith(b"a,b\n1,2.5\n")
    assert not list(Path().glob(".*"))


def exported(path, name="points.csv", *options):
    said = accepted("export", path, "-o", name, *options)
    with open(name, newline="") as text:
        return said, list(csv.DictReader(text))


@pytest.mark.slow
def test_every_scalar_comes_back_to_the_last_bit(path, monkeypatch):
    said, rows = exported(path)
    assert said == "points.csv: 14 rows\n"
    with open_sweep(path) as dataset:
        scalars = [name for name in dataset if dataset[name].dims == ("R", "omega")]
        assert len(scalars) >= 8
        for i, row in enumerate(rows):
            point = dataset.isel(R=i // 7, omega=i % 7)
            assert float(row["R"]) == point["R"] and float(row["omega"]) == point["omega"]
            assert float(row["h"]) == 0.1 and float(row["clearance"]) == 0.0
            for name, kind in (("status", Status), ("class_evidence", Evidence)):
                assert row[name] == kind(int(point[name])).name.lower()
            for name in set(scalars) - {"status", "class_evidence"}:
                given = float(row[name] or "nan")
                assert given == point[name] or (np.isnan(given) and np.isnan(point[name]))
            for k in (0, 1):
                assert float(row[f"lyapunov_{k + 1}"]) == point["lyapunov"][k]
    assert not {"poincare_x", "impact_v"} & set(rows[0])
    told = json.loads(accepted("info", path, "--json"))["classes"]
    words = [row["class"] for row in rows]
    assert words.count("chaotic") == told["chaotic"] and words.count("?") == told["unknown"]
    periodic = [row for row in rows if "/" in row["class"]]
    assert len(periodic) == told["settled on m/q"] + told["on its way to m/q"] > 0
    assert all(row["class"] == f"{row['period']}/{row['period_impacts']}" for row in periodic)
    monkeypatch.setattr("sweeps.opened.coordinates._VALUES_READ", 3)
    exported(path, "parts.csv")
    assert Path("parts.csv").read_bytes() == Path("points.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "dimension", "names"),
    [
        ("sections", "section", ["poincare_x", "poincare_v"]),
        ("impacts", "impact", ["impact_phase", "impact_v"]),
    ],
)
def test_every_record_comes_back_to_the_last_bit(path, monkeypatch, rows, dimension, names):
    """What was not recorded has no row: the points with few impacts have fewer."""
    said, table = exported(path, "rows.csv", "--rows", rows)
    with open_sweep(path) as dataset:
        frame = dataset[names].to_dataframe(dim_order=["R", "omega", dimension])[names].dropna()
    assert said.startswith(f"rows.csv: {len(frame)} rows") and 0 < len(frame) <= 14 * 8
    assert list(table[0]) == ["R", "omega", dimension, *names]
    held = zip(frame.index, frame.values, strict=True)
    expected = [[*map(float, at), *values] for at, values in held]
    assert [[float(cell) for cell in row.values()] for row in table] == expected
    monkeypatch.setattr("sweeps.opened.coordinates._VALUES_READ", 30)
    exported(path, "parts.csv", "--rows", rows)
    assert Path("parts.csv").read_bytes() == Path("rows.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("rows", ["points", "sections", "impacts"])
def test_the_rows_of_a_cut_are_those_of_the_whole_table(path, rows):
    _, whole = exported(path, "whole.csv", "--rows", rows)
    for cuts in ({"R": 0.8}, {"R": 0.5, "omega": 2.0}):
        at = [word for name, value in cuts.items() for word in ("--at", f"{name}={value}")]
        _, cut = exported(path, "cut.csv", "--rows", rows, *at)
        expected = [row for row in whole if all(float(row[n]) == cuts[n] for n in cuts)]
        assert cut == expected and 0 < len(cut) < len(whole)
    moved = call("export", path, "-o", "cut.csv", "--at", "omega=2.01")
    assert moved.stderr == "omega = 2.01 is not on the grid; written at omega = 2\n"


def test_the_rows_of_a_sweep_followed_both_ways_are_cut_by_direction():
    overrides = ["oscillator.R=0.5", "follow.axis=omega", "follow.direction=both"]
    path = run_sweep(load_config("sweep.yaml", overrides), "both.h5")
    _, whole = exported(path, "whole.csv")
    _, down = exported(path, "down.csv", "--at", "direction=down")
    assert down == [row for row in whole if row["direction"] == "down"] and len(whole) == 14


@pytest.mark.parametrize(
    ("cut", "reason"),
    [
        ("R", "expected: NAME=VALUE"),
        ("omgea=2", "omgea cannot be fixed here (did you mean omega?)"),
        ("omega=4", "omega = 4 is outside the sweep: 1 to 3"),
    ],
)
def test_a_cut_that_the_sweep_has_not_is_refused(path, cut, reason):
    assert reason in refused("export", path, "-o", "cut.csv", "--at", cut)
    assert not Path("cut.csv").exists()


def test_the_rows_of_a_table_have_its_columns():
    points = "points: {omega: [2.0, 2.5], serial: [A1, A2]}"
    text = CONFIG.replace("omega: {start: 1.0, stop: 3.0, num: 7}, ", "")
    text = text.replace("[0.5, 0.8]", "0.5")
    path = run_sweep(load_config(yaml.safe_load(text + points)), "table.h5")
    _, table = exported(path, "rows.csv", "--rows", "sections")
    assert list(table[0].values())[:4] == ["1", "2.0", "A1", "21"]
    assert list(table[0])[:4] == ["point", "omega", "serial", "section"] and len(table) == 16
    _, second = exported(path, "second.csv", "--rows", "sections", "--at", "point=2")
    assert second == table[8:]


@pytest.mark.parametrize("group", ["oscillator: {h: 0.1, R: 0.8, f: 1.0}", rig(frequency=None)])
def test_the_table_of_points_is_not_replaced(group):
    """Not even after an empty line or of a rig; a table that was exported before is."""
    text = "\n omega , serial\n2.0,a\n2.5,b\n"
    Path("sweep.yaml").write_text(f"points: table.csv\n{group}\n")
    Path("table.csv").write_text(text.strip())
    run_sweep("sweep.yaml", "out.h5")
    Path("table.csv").write_text(text)
    for words in (
        ["export", "out.h5", "-o", "table.csv"],
        ["export", "out.h5", "-o", "table.csv", "--rows", "sections"],
        ["attractors", "out.h5", "--csv", "table.csv"],
        ["bench", "accuracy-speed", "sweep.yaml", "--csv", "table.csv"],
        ["bench", "accuracy-speed", "out.h5", "--csv", "table.csv"],
    ):
        assert "table.csv is a table of points like that of the sweep" in refused(*words)
    assert Path("table.csv").read_text() == text
    assert exported("out.h5") == exported("out.h5")


@pytest.mark.parametrize("first", ["x" * 131_073, '"omega', "", "\0", "omega,other"])
def test_what_is_no_table_of_points_is_replaced(first):
    """Whatever its first line, also one longer than what a reader of CSV takes for a cell."""
    Path("sweep.yaml").write_text("oscillator: {h: 0.1, R: 0.8, f: 1.0}\npoints: {omega: [2, 3]}\n")
    run_sweep("sweep.yaml", "out.h5")
    Path("old.csv").write_text(f"{first}\n1\n")
    assert exported("out.h5", "old.csv")[1] == exported("out.h5", "new.csv")[1]


def test_a_record_that_the_file_lacks_is_refused():
    path = run_sweep(load_config("sweep.yaml", ["record.impacts=0"]), "out.h5")
    assert "record.impacts" in refused("export", path, "-o", "a.csv", "--rows", "impacts")
    expected = "--rows = 'knocks' is not allowed; expected: one of points, sections, impacts"
    assert expected in refused("export", path, "-o", "a.csv", "--rows", "knocks")
    assert not Path("a.csv").exists()


@pytest.mark.slow
def test_a_single_point_is_a_row():
    overrides = ["oscillator.R=0.5", "oscillator.omega=2.0"]
    _, (row,) = exported(run_sweep(load_config("sweep.yaml", overrides), "out.h5"))
    assert (row["R"], row["omega"], row["period"]) == ("0.5", "2.0", "1")
    _, table = exported("out.h5", "rows.csv", "--rows", "sections")
    assert [row["section"] for row in table] == [str(n) for n in range(21, 29)]


def test_what_cannot_be_written_is_refused(path):
    os.mkfifo("fifo.csv")
    for name, text in (
        ("points.txt", "expected: a .csv file"),
        ("no/points.csv", "the folder no of the table points.csv does not exist"),
        ("fifo.csv", "fifo.csv is a FIFO, not a regular file,"),
        ("points.parquet", "expected: a .csv file"),
    ):
        assert text in refused("export", path, "-o", name)
    assert sorted(path.name for path in Path().iterdir()) == ["fifo.csv", "sweep.yaml"]
