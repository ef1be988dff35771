"""The benches: results against known values of their scenes, and the commands."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from sweeps.bench import failures, paper_cases, speed
from sweeps.bench.paper_cases import paper_picture
from tests.helpers.commands import call
from vibroimpact.jit import NUMERICS
from vibroimpact.step.integrators import INTEGRATORS, spectral_radius


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["accuracy-speed", "absent.yaml"], ["absent.yaml does not exist"]),
        (["accuracy-speed", "-o", "a.jpg"], ["a.jpg must end in one of .png, .svg, .pdf, .eps"]),
        (["accuracy-speed", "--csv", "a.txt"], ["--csv a.txt ", ".csv"]),
        (["accuracy-speed", "--threads", "0"], ["--threads 0 ", "an integer from 1 to "]),
        (["paper", "-o", "a.jpg"], ["a.jpg must end in one of .png, .svg, .pdf, .eps"]),
        (["speed", "--json", "a.txt"], ["--json a.txt ", "a .json file"]),
        (["speed", "--json", "nowhere/a.json"], ["folder nowhere of the JSON file a.json does"]),
        (["speed", "--fail-below", "0"], ["--fail-below 0 ", "a number above 0, at most 1"]),
    ],
)
def test_a_wrong_request_is_refused_before_anything_is_measured(monkeypatch, arguments, words):
    for measure in (
        "accuracy.measure_methods",
        "paper_cases.measure_cases",
        "failures.measure_failures",
        "speed.measure_speed",
    ):
        monkeypatch.setattr(f"sweeps.bench.{measure}", lambda *_, **__: pytest.fail("it was run"))
    result = call("bench", *arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith("vibroimpact: error: ") and result.stderr.count("\n") == 1
    for part in words:
        assert part in result.stderr
    assert not list(Path().iterdir())


_KEYS = ("steps", "periods", "computed", "impacts", "share", "alone", "spread")
RECORD = speed.speed_record(
    58e9,
    {
        name: dict(zip(_KEYS, values, strict=True))
        for name, *values in (
            ("plain", 100, {1: 30e6, 2: 57e6}, 28e6, 31e6, 0.4, math.nan, 0.0),
            ("exact, chatter", 116, {1: 0.3e6, 2: 0.6e6}, 0.2e6, 4e6, 0.0048, 0.07, 0.0),
        )
    },
)


@pytest.fixture
def small(monkeypatch):
    """One work of one block, and a peak that takes no time."""
    monkeypatch.setattr(speed, "WORKS", {"exact": ("chaos", {})})
    monkeypatch.setattr(speed, "_TIMES", 500)


def test_the_share_follows_from_rate_steps_and_peak(small):
    """In chaos most periods are computed, with 1.6 impacts each; few steps are followed alone."""
    record = speed.measure_speed(count=30, periods=150)
    exact = SimpleNamespace(**record["works"]["exact"])
    assert exact.steps == 7
    assert 0.9 * exact.periods[1] < exact.computed <= exact.periods[1]
    assert exact.share == pytest.approx(exact.computed * 7 * 8 / record["peak"])
    assert 0.0 < exact.share < 1.0
    assert exact.impacts == pytest.approx(1.6 * exact.computed, rel=0.15)
    assert 0.0 < exact.alone < 0.01
    assert exact.spread >= 0.0


def test_copied_periods_are_not_computed():
    """The paper's dissipative case comes back to the same bits soon; it has 4 impacts a period."""
    points = speed.points_over(speed.OmegaRange(0.5, 0.5, 1.0, 1.0, 1), 3)
    done, steps = speed.effort_of(points, {}, 200, 100)
    assert 3 < done.periods < 3 * 60 and steps == 15
    assert done.impacts == 4 * done.periods
    assert done.alone == 3  # the first step of each, which begins on the stop


def test_the_peak_loop_adds_and_multiplies():
    """Its fixed point is 1; from 0 it comes as near as 0.999^n."""
    sums = np.zeros(speed._SUMS)
    speed._multiply_adds(sums, 100)
    np.testing.assert_allclose(sums, 1.0 - 0.999 ** (100 * speed._CHAIN), rtol=1e-12)


def test_the_command_shows_the_speeds_and_writes_them_as_json_and_is_a_gate(monkeypatch):
    """The geometric mean of the shares 0.4 and 0.0048 is 0.0438."""
    monkeypatch.setattr(speed, "measure_speed", lambda count, periods, report: RECORD)
    mean = math.sqrt(0.4 * 0.0048)
    done = call("bench", "speed", "--json", "speed.json", "--fail-below", 0.99 * mean)
    assert done.exit_code == 0 and done.stdout.endswith("speed.json\n"), done.stderr
    assert "58e9 multiply-adds" in done.stdout
    assert "geometric mean of the shares: 4.382%" in done.stdout
    (row,) = [line.split() for line in done.stdout.splitlines() if "plain" in line]
    assert row == ["plain", "100", "30", "57", "1.90", "28", "31", "40.0%"]
    (row,) = [line.split() for line in done.stdout.splitlines() if "exact, chatter" in line]
    assert row[2:] == ["116", "0.3", "0.6", "2.00", "0.2", "4", "7.00%", "0.5%"]
    text = Path("speed.json").read_text()
    found = json.loads(text)
    assert text.endswith("}\n") and found["numerics"] == NUMERICS
    assert found["mean_share"] == pytest.approx(mean, rel=1e-12)
    assert found["peak"] == 58e9 and list(found["works"]) == list(RECORD["works"])
    assert found["works"]["plain"]["periods"] == {"1": 30e6, "2": 57e6}
    assert found["works"]["plain"]["alone"] is None
    below = call("bench", "speed", "--json", "speed.json", "--fail-below", 1.01 * mean)
    assert below.exit_code == 1 and "is 0.04382, below 0.044" in below.stderr
    assert "multiply-adds" in below.stdout and "Traceback" not in below.stderr
    one_core = RECORD["works"]["plain"] | {"periods": {1: 30e6}}
    assert "speed-up" in done.stdout
    assert "speed-up" not in speed.speed_text(RECORD | {"works": {"plain": one_core}})
    many = RECORD["works"]["plain"] | {"periods": {1: 30e6, 64: 1.912e9}}
    assert "     30       1,912  " in speed.speed_text(RECORD | {"works": {"plain": many}})


# Known of the three cases: impacts per period, their speeds, and the order to the letter, which
# the acceleration of eq. (10) costs where h > 0.
KNOWN = {
    "conservative impacts": (2, (0.902040564502884, 0.411362031140622), 1),
    "conservative inter-impact motion": (2, (2.037529035119366, 0.811704646702102), 2),
    "fully dissipative": (4, (0.907496491171004, 0.036454221377120), 1),
}


@pytest.fixture(scope="module")
def measured():
    """Measurements with few step sizes."""
    return paper_cases.measure_cases(ladder=(400, 800, 1600), spread=4, stalling=(100, 10_000))


@pytest.mark.slow
@pytest.mark.parametrize("name", KNOWN)
def test_the_claim_and_the_orders(measured, name):
    case, (impacts, speeds, order) = measured.cases.loc[name], KNOWN[name]
    assert case.impacts["exact"] == case.impacts["with"] == impacts * paper_cases.PERIODS
    # The first impact is the fastest.
    deepest = 1.3 * max(speeds) * 2.0 * math.pi / paper_cases.STEPS_OF_PAPER
    assert 0.3 * deepest < case.deepest["without"] < deepest
    assert case.deepest["with"] == case.deepest["to the letter"] == 0.0
    assert case.order["without"] == pytest.approx(1, abs=0.25)
    assert case.order["with"] == pytest.approx(2, abs=0.25)
    assert case.order["to the letter"] == pytest.approx(order, abs=0.25)


def test_an_impact_that_never_comes_is_an_infinite_error():
    """To the letter the chatter stalls after two impacts."""
    chatter = paper_cases.CHATTER, (100,), 1, paper_cases.simulate(paper_cases.CHATTER)
    errors = paper_cases._errors("to the letter", *chatter)
    assert errors[0] == np.inf


def test_the_picture_shows_what_was_measured(measured):
    panels = paper_picture(measured).axes
    assert len(panels) == 7
    for panel, name in zip(panels[1:6:2], KNOWN, strict=True):
        for line, errors in zip(panel.lines, measured.cases.loc[name].errors.dropna(), strict=True):
            np.testing.assert_array_equal(line.get_xdata(), measured.ladder)
            np.testing.assert_array_equal(line.get_ydata(), errors)
    assert [text.get_text() for text in panels[6].texts] == [
        "100 steps\n$t = 12.1144$", "10000 steps\n$t = 12.4103$"
    ]  # fmt: skip


@pytest.mark.slow
def test_the_command_draws_the_papers_cases_and_prints_their_numbers(measured, monkeypatch):
    monkeypatch.setattr("sweeps.bench.paper_cases.measure_cases", lambda: measured)
    done = call("bench", "paper")
    assert done.exit_code == 0, done.stderr
    for part in ("0.042", "0.078", "0.043", "12.41264", "12.11439", " 60 "):
        assert part in done.stdout
    *tables, name = done.stdout.splitlines()
    assert name == "paper.png" and max(map(len, tables)) <= 100
    assert Path("paper.png").read_bytes().startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def figures():
    return failures.measure_failures()


def test_the_chart_is_the_spectral_radius():
    """Its region of growth is that beyond the closed form."""
    drawn = failures.stability_chart(quick=True)
    panels = [panel for panel in drawn.axes if panel.get_title()]
    assert [panel.get_title().split(",")[0] for panel in panels] == list(INTEGRATORS)
    step, zeta = np.linspace(0.0, 4.0, 81), np.linspace(0.0, 2.0, 41)
    for panel, (name, integrator) in zip(panels, INTEGRATORS.items(), strict=True):
        (mesh,), (line,) = panel.collections, panel.lines
        corners = mesh.get_coordinates()
        np.testing.assert_allclose(0.5 * (corners[0, 1:, 0] + corners[0, :-1, 0]), step, atol=1e-12)
        np.testing.assert_allclose(0.5 * (corners[1:, 0, 1] + corners[:-1, 0, 1]), zeta, atol=1e-12)
        radius, limit = mesh.get_array(), integrator.limit(zeta)[:, None]
        np.testing.assert_allclose(radius, spectral_radius(name, step, zeta[:, None]), atol=2e-9)
        assert (radius[step < limit] <= 1.0 + 1e-7).all()
        assert (radius[step > 1.001 * limit] > 1.0).all()
        np.testing.assert_array_equal(line.get_xydata(), np.stack([limit[:, 0], zeta], axis=1))


@pytest.mark.slow
def test_what_the_failures_are(figures):
    """The figures that are known of the scenes: of other code, or of the exact motion."""
    known = {
        ("newmark", "to the letter", "stalls at"): (12.114, 5e-4),
        ("newmark", "to the letter", "impacts"): (60, 0),
        ("newmark", "plain", "at rest"): (39, 1),
        ("newmark", "plain", "impacts"): (60, 0),
        ("newmark", "plain", "graze at"): (3.64, 5e-3),
        ("newmark", "reduced-step", "impacts"): (80, 0),
        ("rk4", "plain", "energy"): (0.961, 1e-3),
        ("rk4", "cubic", "energy"): (1.0, 1e-3),
        ("rk4", "cubic", "graze at"): (2.8308, 1e-3),
        ("rk4", "reduced-step", "touch from"): (1.0, 1e-2),
        ("rk4", "plain", "p T = pi"): (math.inf, 0),
        ("exact", "exact", "touch from"): (0.0, 1e-8),
        ("exact", "exact", "slowest"): (0.036454221377120, 1e-12),
        ("exact", "exact", "energy"): (1.0, 1e-12),
        ("exact", "exact", "graze at"): (2.8308, 5e-5),
    }
    for (integrator, rule, name), (value, allowed) in known.items():
        figure = figures[failures.Method(integrator, rule), name]
        assert figure == value or abs(figure - value) <= allowed, (integrator, rule, name)
    energies = {m: figures[m, "energy"] for m in failures.TESTED_METHODS if m != failures.LETTER}
    assert all(energies[m] > 1e3 for m in energies if m.integrator == "euler")


def test_only_exact_impacts_never_fail_and_every_failure_is_seen(figures):
    for failure in failures.FAILURES:
        fails = {m: failure.fails(figures[m, failure.name]) for m in failures.TESTED_METHODS}
        assert any(fails.values()) and not fails[failures.EXACT_METHOD], failure.name
    methods = [m for m in failures.TESTED_METHODS if m.integrator in ("newmark", "rk4")]
    failing = {
        failure.name: {m.impact for m in methods if failure.fails(figures[m, failure.name])}
        for failure in failures.FAILURES
    }
    assert failing["energy"] == {"plain", "reduced-step"}
    assert failing["at rest"] == failing["astray"] == failing["depth"] == {"plain"}
    coarse = next(failure for failure in failures.FAILURES if failure.name == "p T = pi")
    assert coarse.fails(0.623) and not coarse.fails(1.62)
    assert failing["touch from"] == {"plain", "reduced-step", "cubic"}


def test_the_tables_fit_a_terminal_and_mark_the_failures(figures):
    text = failures.limit_table() + "".join(failures.failure_tables(figures))
    assert max(len(line) for line in text.splitlines() if ": " not in line) <= 80
    lines = {line.strip().split("  ")[0]: line for line in text.splitlines()}
    assert lines["euler plain"].count("!") == 3  # of the last table
    assert "every step" in lines["newmark"] and lines["rk4"].split() == ["rk4", "0", "2.8284"]
    assert lines["exact exact"].count("!") == 0
    assert "never" in text and "12.11!" in text and "no step" in text and "nan" not in text
    for failure in failures.FAILURES:
        assert f"{failure.name}: " in text


@pytest.mark.slow
def test_the_command_shows_the_failures(figures, monkeypatch):
    """Picture, tables on the terminal, and every figure in the CSV file."""
    monkeypatch.setattr(failures, "measure_failures", lambda: figures)
    result = call("bench", "stability", "--quick", "--csv", "all.csv")
    assert result.exit_code == 0, result.output
    assert "Greatest stable p T" in result.stdout
    assert result.stdout.endswith("stability.png\nall.csv\n")
    assert Path("stability.png").read_bytes().startswith(b"\x89PNG")
    rows = pd.read_csv("all.csv")
    assert list(rows) == ["method", "figure", "scene", "value"]
    limit = rows[rows["figure"] == "limit of p T"].set_index(["method", "scene"])["value"]
    assert limit["rk4", "h/p = 0"] == pytest.approx(2.0 * math.sqrt(2.0), rel=1e-14)
    assert limit["newmark", "h/p = 2"] == math.inf
    assert (rows["method"] == "newmark to the letter").any()
    assert len(rows) > len(INTEGRATORS) * 5 + 100
