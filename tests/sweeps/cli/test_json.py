"""``--json``: the same as the text and the CSV file, in strict JSON."""

import json
import math
import subprocess
import sys
import unicodedata
from pathlib import Path

import pandas as pd
import pytest
import yaml

from sweeps import load_config, open_sweep
from sweeps.opened.export import json_text
from sweeps.text import printable
from tests.helpers.commands import accepted, call, refused
from tests.helpers.interruptions import environment
from tests.helpers.sweep_files import run_in

SWEEP = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 2.6, stop: 2.7, num: 8}, f: 1.0}
record: {transient: 200, periods: 16, impacts: 4, diagnostics: [period]}
"""
FILES = {"starts": """\
rig: {mass: 2, stiffness: 2, damping: 0.4, force: 2, gap: 0.6, R: 0.8, frequency: 0.41}
start: {x0: {start: -3, stop: 0.5, num: 6}, v0: {start: -3, stop: 3, num: 6}}
record: {transient: 100, periods: 32, diagnostics: [period]}
"""}  # fmt: skip


def strict(text):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_info(path):
    found = strict(accepted("info", path, "--json"))
    with open_sweep(path) as data:
        assert found["axes"]["omega"]["values"] == data["omega"].values.tolist()
        assert found["variables"].keys() == set(data.data_vars)
        assert found["configuration"] == yaml.safe_load(data.attrs["configuration"])
        settled = int((data["orbit_distance"] <= 1e-6).sum())
    assert (found["points"], sum(found["outcomes"].values())) == (8, 8)
    assert found["classes"]["settled on m/q"] == settled
    assert sum(found["classes"].values()) == 8
    assert found["variables"]["poincare_x"]["dimensions"] == {"omega": 8, "section": 16}


def test_info_of_bifurcations(path, tmp_path):
    done = call("info", path, "--bifurcations", "--json", "--csv", tmp_path / "b.csv")
    assert done.exit_code == 0, done.stderr
    found = strict(done.stdout)
    assert "b.csv" in done.stderr
    rows = pd.read_csv(tmp_path / "b.csv")
    assert found["axis"] == "omega" and len(found["bifurcations"]) == len(rows) > 0
    (first, row), *_ = zip(found["bifurcations"], rows.to_dict("records"), strict=True)
    assert list(first) == list(row)
    assert first["kind"] == "flip" and first["value"] == row["value"]
    assert first["impact_v"] == [float(row["impact_v"])]


@pytest.mark.parametrize("command", ["attractors", "integrity"])
def test_attractors(command, files, tmp_path, no_knocks):
    done = call(command, files / "starts.h5", "--json", "--csv", tmp_path / "a.csv")
    assert done.exit_code == 0, done.stderr
    rows = pd.read_csv(tmp_path / "a.csv").to_dict("records")
    found = strict(done.stdout)["attractors"]
    assert len(found) == len(rows) > 0
    for one, row in zip(found, rows, strict=True):
        assert list(one) == list(row) and one["fraction"] == row["fraction"]
        assert len(one["impact_v"]) == one["q"]


def test_a_single_point_and_a_table(tmp_path):
    single = run_in(tmp_path, SWEEP, "oscillator.omega=2.6", name="single.h5")
    found = strict(accepted("info", single, "--json"))
    assert (found["points"], found["axes"]) == (1, {})
    text = "oscillator: {h: 0.1, R: 0.8, f: 1}\npoints: {omega: [2.5, 2.6], serial: [k1, k2]}\n"
    table = run_in(tmp_path, text, "record.transient=9", "record.periods=4", name="table.h5")
    found = strict(accepted("info", table, "--json"))
    assert found["columns"] == ["omega", "serial"]
    assert found["axes"]["point"]["values"] == [1, 2]


def test_numbers_that_json_has_not():
    text = json_text({"a": [math.nan, math.inf, -math.inf, 0.1], "b": None, "c": True})
    assert strict(text) == {"a": [None, "inf", "-inf", 0.1], "b": None, "c": True}


def test_json_excludes_the_configuration_alone(path):
    assert "exclude each other" in refused("info", path, "--config", "--json")


#: Characters that a name can have: all that are common, and one in 128 of the others.
FURTHER = [*range(0x3100, 0xD800, 2**7), *range(0xE000, 2**20, 2**7), 0xFEFF, 0xFFFE, 0xFFFF]
CHARACTERS = "".join(map(chr, [*range(0x3100), *FURTHER, sys.maxunicode]))
#: A no-break space, two of other widths, DEL, CSI, NEL, separators, a mark of direction, a tag.
#: The controls may be in a cell of a table, not in a name.
ODD = "a\xa0b\u2007\u3000\x7f\x9b\x85\u2028\u202e\ufeff\U000e0001\\xa0 \"日😀\x1b[31m$'c"
ODD_NAME = "".join(c for c in ODD if unicodedata.category(c) != "Cc" and c != "\\")
ODD_TABLE = f"""\
name: {json.dumps(ODD_NAME)}
output: odd.h5
oscillator: {{h: 0.1, R: 0.8, f: 1}}
points: {{omega: [2.5, 2.6], serial: [{json.dumps(ODD)}, k2]}}
record: {{transient: 9, periods: 8, diagnostics: [period]}}
"""


@pytest.mark.slow
def test_every_character_is_the_same_in_json_and_in_yaml_on_a_terminal_too():
    """As a program reads them from what a command prints, which escapes what a terminal obeys."""
    text = json_text({CHARACTERS: [CHARACTERS]})
    assert printable(text) == text and strict(text) == {CHARACTERS: [CHARACTERS]}
    config = load_config({"oscillator": {"h": 0.1, "R": 0.8, "omega": 1, "f": 1}})
    for start in range(0, 0x3100, 512):
        every = "x" + CHARACTERS[start : start + 512].replace("\0", "") + "x"
        text = config.model_copy(update={"name": every}).to_yaml()
        assert printable(text) == text and yaml.safe_load(text)["name"] == every


@pytest.mark.slow
def test_a_name_of_odd_characters_comes_back_from_every_command(folder):
    Path("odd.yaml").write_text(ODD_TABLE, encoding="utf-8")
    accepted("run", "odd.yaml", "--quiet")
    found = strict(accepted("info", "odd.h5", "--json"))
    assert found["name"] == found["configuration"]["name"] == ODD_NAME
    Path("again.yaml").write_text(accepted("info", "odd.h5", "--config"), encoding="utf-8")
    again, first = load_config("again.yaml"), load_config("odd.yaml")
    assert again.name == ODD_NAME and again.points.tolist() == first.points.tolist()
    plain = ("--set", "name=größe σ", "--set", "points={omega: [2.5]}", "-o", "plain.h5")
    accepted("run", "odd.yaml", "--quiet", *plain)
    assert "name: größe σ\n" in accepted("info", "plain.h5", "--config")
    for encoding, option, file, name in (
        ("utf-16", "--json", "odd.h5", ODD_NAME),
        ("cp1252", "--config", "plain.h5", "größe σ"),  # in ASCII, whatever the console has
    ):
        command = [sys.executable, "-m", "sweeps.cli", "info", file, option]
        env = {**environment(), "PYTHONIOENCODING": encoding}
        done = subprocess.run(command, env=env, capture_output=True, check=True, timeout=300)
        text = done.stdout.decode("ascii" if option == "--config" else encoding)
        assert (strict(text) if option == "--json" else yaml.safe_load(text))["name"] == name


def test_the_schema_is_json():
    assert strict(accepted("schema"))["$id"]
