"""The curves over a map, against the closed form, and the shares that they explain."""

import csv
import math
import re

import numpy as np
import pytest

from commands import accepted
from sweep_files import run_in
from sweeps import curves, open_sweep
from sweeps.analysis import exact_curves
from sweeps.errors import Refused
from sweeps.plotting import parameter_map
from vibroimpact.orbits.branches import Branch, SpecialPoint
from vibroimpact.orbits.continuation import MOST_POINTS
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.oscillator import Oscillator

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
    assert found.attrs["changes"] > 5
    assert found.attrs["explained"] == found.attrs["changes"]
    first = int(np.flatnonzero((found["kind"] == "flip") & (found["m"] == 1))[0])
    own = found["curve"].values == first
    omega, R = found["omega"].values[own], found["R"].values[own]
    curve = np.cos(math.pi / omega) ** 2 * (omega**2 - ((1.0 - R) / (1.0 + R)) ** 2)
    assert np.abs(curve - 1.0).max() < 1e-12
    assert (found["special_kind"].values[found["special_curve"].values == first] == "edge").all()
    with open_sweep(path) as dataset:
        panel = parameter_map(dataset, exact=found).axes[0]
    assert "1/1" in [text.get_text() for text in panel.texts]


@pytest.mark.slow
def test_the_command_draws_them_and_writes_a_table(path, tmp_path):
    picture, table = tmp_path / "map.png", tmp_path / "curves.csv"
    said = accepted("plot", path, "--kind", "map", "--exact", "-o", picture, "--csv", table)
    assert "exact curve" in said and "(100.0 %)" in said
    assert picture.stat().st_size > 1000
    with table.open() as file:
        rows = list(csv.DictReader(file))
    with open_sweep(path) as dataset:
        found = curves(dataset)
    assert len(rows) == found.sizes["point"] + found.sizes["special"]
    assert float(rows[0]["omega"]) == found["omega"].values[0]


def test_a_map_of_starts_has_no_curves(tmp_path):
    changes = "oscillator.R=0.8", "oscillator.omega.num=2", "start.x0=[-1.0, -0.5]", "follow=null"
    with open_sweep(run_in(tmp_path, CONFIG, *changes)) as dataset:
        with pytest.raises(Refused, match="do not depend on x0"):
            curves(dataset, ["omega", "x0"])


MAP = """
oscillator: {h: 0.02, R: 0.9, clearance: 1.0, f: {start: 0.345, stop: 0.385, num: 21},
             omega: {start: 0.782, stop: 0.80, num: 21}}
record: {transient: 600, periods: 32, diagnostics: [period, lyapunov]}
"""


@pytest.mark.slow
def test_every_change_has_a_curve_or_a_reason(tmp_path):
    """Beside the fold of 2/1, where free motion and 2/2 coexist."""
    with open_sweep(run_in(tmp_path, MAP)) as dataset:
        found = curves(dataset)
    changes, explained = found.attrs["changes"], found.attrs["explained"]
    assert 0 < explained < changes
    summary = found.attrs["summary"]
    counts = dict(reversed(pair) for pair in re.findall(r"^  (\d+): (.*) \(.*\)$", summary, re.M))
    assert sum(map(int, counts.values())) == changes - explained
    decides = "both motions are stable on both sides, and the start decides"
    assert int(counts[decides]) > 10
    assert f"{counts[decides]}: {decides} (1/0 and 2/2" in summary
    grazes = (found["kind"] == "graze") & (found["m"] == 1) & (found["q"] == 1)
    own = found["curve"].values == np.flatnonzero(grazes)[0]
    omega, f = found["omega"].values[own], found["f"].values[own]
    assert np.abs(f - np.hypot(1.0 - omega**2, 0.04 * omega)).max() < 1e-13


def test_a_border_that_cannot_be_followed_is_a_reason(path, monkeypatch):
    def refuse(*_):
        raise OrbitError("the flip does not go on")

    monkeypatch.setattr(exact_curves, "bifurcation_curve", refuse)
    with open_sweep(path) as dataset:
        found = curves(dataset)
    assert found.sizes["number"] == found.attrs["explained"] == 0 < found.attrs["changes"]
    assert "the flip does not go on" in found.attrs["summary"]


def test_a_curve_that_is_lost_says_where_and_why():
    orbit = PeriodicOrbit(
        Oscillator(h=0.02, R=0.9, omega=2.0, f=1.0), 1, *np.array([[1, 2], [4, 1]])
    )
    for points, reason in (
        (MOST_POINTS, "not at its end after 2,000 points"),
        (9, "Newton's method"),
    ):
        values = np.full((points, 2), 0.5)
        end = SpecialPoint("lost", np.array([0.25, 2.0]), orbit)
        speeds = np.ones((points, 2))
        rows = values, speeds[:, 0] < 0.0, speeds, speeds
        curve = Branch("flip", ("R", "omega"), 1, 2, *rows, [end], orbit.oscillator)
        (_, _, line) = exact_curves.summary([curve], 0, 0, {}).split("\n")
        assert line.startswith("a curve of flips of 1/2 is lost at R = 0.25, omega = 2: " + reason)
        assert line.endswith("the slowest impact has 2e-01 of the speed of the fastest")
