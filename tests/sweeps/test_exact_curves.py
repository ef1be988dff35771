"""The curves over a map, against the closed form, and the shares that they explain."""

import csv
import math

import numpy as np
import pytest

from commands import call
from sweep_files import run_in
from sweeps import curves, load_config, open_sweep, run_sweep
from sweeps.analysis.exact_curves import find_curves
from sweeps.errors import Refused

CONFIG = """
name: the flip of one impact per period
oscillator:
  {h: 0.0, R: {start: 0.5, stop: 0.9, num: 12}, omega: {start: 2.6, stop: 2.72, num: 30}, f: 1.0}
follow: {axis: omega, direction: up}
record: {transient: 300, periods: 16, diagnostics: [period]}
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return run_in(tmp_path_factory.mktemp("map"), CONFIG)


def test_the_flips_of_the_map_are_on_the_closed_form(path):
    with open_sweep(path) as dataset:
        found = curves(dataset)
    assert found.attrs["changes"] > 10
    assert found.attrs["explained"] == found.attrs["changes"]
    first = int(np.flatnonzero((found["kind"] == "flip") & (found["m"] == 1))[0])
    own = found["curve"].values == first
    omega, R = found["omega"].values[own], found["R"].values[own]
    curve = np.cos(math.pi / omega) ** 2 * (omega**2 - ((1.0 - R) / (1.0 + R)) ** 2)
    assert np.abs(curve - 1.0).max() < 1e-12
    assert (found["special_kind"].values[found["special_curve"].values == first] == "edge").all()


def test_the_command_draws_them_and_writes_a_table(path, tmp_path):
    picture, table = tmp_path / "map.png", tmp_path / "curves.csv"
    command = ["plot", str(path), "--kind", "map", "--exact", "-o", str(picture)]
    result = call(*command, "--csv", str(table))
    assert result.exit_code == 0, result.output
    assert "exact curve" in result.output and "(100.0 %)" in result.output
    assert picture.stat().st_size > 1000
    with table.open() as file:
        rows = list(csv.DictReader(file))
    with open_sweep(path) as dataset:
        search = find_curves(dataset)
    assert len(rows) == sum(len(one.values) + len(one.special) for one in search.curves)
    assert float(rows[0]["omega"]) == search.curves[0].values[0, 0]


def test_info_lists_the_exact_bifurcations(path):
    result = call("info", str(path), "--bifurcations", "--at", "R=0.9")
    assert result.exit_code == 0, result.output
    flip = 2.6528859  # the upper edge of the stable window of model.md, section 3
    lines = [line.split() for line in result.output.splitlines()]
    values = [float(words[2]) for words in lines if words[-2:] == ["flip", "1/1"]]
    assert np.abs(np.array(values) - flip).min() < 1e-6


def test_a_map_of_starts_has_no_curves(tmp_path):
    (tmp_path / "c.yaml").write_text(
        CONFIG.replace("R: {start: 0.5, stop: 0.9, num: 12}", "R: 0.8")
        .replace("follow: {axis: omega, direction: up}", "start: {x0: [-1.0, -0.5]}")
        .replace("num: 30", "num: 2")
    )
    with open_sweep(run_sweep(load_config(tmp_path / "c.yaml"), tmp_path / "a.h5")) as dataset:
        with pytest.raises(Refused, match="do not depend on x0"):
            find_curves(dataset, ["omega", "x0"])
