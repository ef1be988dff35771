"""How stability and failures are measured: against closed forms and what is known of the scenes."""

import csv
import math
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest

from commands import call
from sweeps.bench import failures, stability
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.stability import spectral_radius

EXACT = failures.Method("exact", "exact")


@pytest.fixture(scope="module")
def limits():
    return stability.limits(quick=True)


@pytest.fixture(scope="module")
def figures():
    return failures.measure()


def test_the_limits_agree(limits):
    """A run sees growth above SEEN / steps a step, so that its limit is a little greater."""
    assert list(limits) == list(INTEGRATORS)
    for name, found in limits.items():
        closed, radius, run = found["closed"], found["radius"], found["run"]
        np.testing.assert_array_equal(closed, INTEGRATORS[name].limit(stability.ZETAS))
        some = np.isfinite(closed)
        np.testing.assert_array_equal(np.isfinite(radius), some)
        np.testing.assert_array_equal(np.isfinite(run), some)
        np.testing.assert_allclose(radius[some], closed[some], atol=5e-7)
        positive = some & (closed > 0.0)
        np.testing.assert_allclose(run[positive], closed[positive], rtol=3e-3)
    # Euler without damping grows by p^2 T^2 / 2 a step.
    seen = math.sqrt(2.0 * stability.SEEN / stability.STEPS_QUICK)
    assert limits["euler"]["run"][0] == pytest.approx(seen, rel=0.02)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_run_tells_growth_from_none(name):
    """Beyond the limit, far beyond, where the state overflows at once, and before it."""
    zeta = stability.ZETAS
    limit = np.minimum(INTEGRATORS[name].limit(zeta), 50.0)
    assert not stability.grows(name, 0.99 * limit + 1e-9, zeta, 3000).any()
    if limit.max() < 50.0:
        for step in (1.05 * limit + 0.05, 4.0 * limit + 1.0, 100.0 + 0.0 * limit):
            assert stability.grows(name, step, zeta, 3000).all()


def test_the_chart_is_the_spectral_radius():
    """Its region of growth is that beyond the closed form."""
    drawn = stability.picture(quick=True)
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
    energies = {m: figures[m, "energy"] for m in failures.METHODS if m != failures.LETTER}
    assert all(energies[m] > 1e3 for m in energies if m.integrator == "euler")


def test_only_exact_impacts_never_fail_and_every_failure_is_seen(figures):
    for failure in failures.FAILURES:
        fails = {m: failure.fails(figures[m, failure.name]) for m in failures.METHODS}
        assert any(fails.values()) and not fails[EXACT], failure.name
    methods = [m for m in failures.METHODS if m.integrator in ("newmark", "rk4")]
    failing = {
        name: {m.impact for m in methods if failure.fails(figures[m, name])}
        for name, failure in {failure.name: failure for failure in failures.FAILURES}.items()
    }
    assert failing["energy"] == {"plain", "reduced-step"}
    assert failing["at rest"] == failing["astray"] == failing["depth"] == {"plain"}
    assert failing["touch from"] == {"plain", "reduced-step", "cubic"}


def test_the_tables_fit_a_terminal_and_mark_the_failures(limits, figures):
    text = stability.table_of(limits) + "".join(failures.tables(figures))
    assert max(len(line) for line in text.splitlines() if ": " not in line) <= 80
    lines = {line.strip().split("  ")[0]: line for line in text.splitlines()}
    assert lines["euler plain"].count("!") == 3  # of the last table
    assert "every step" in lines["newmark"] and "> 10" in lines["newmark"]
    assert lines["exact exact"].count("!") == 0
    assert "never" in text and "12.11!" in text and "no step" in text
    for failure in failures.FAILURES:
        assert f"{failure.name}: " in text


def test_a_figure_is_written_as_its_failure_says():
    failure = SimpleNamespace(digits=".2f", fails=lambda value: value > 1.0)
    shown = [failures.shown(failure, value) for value in (0.5, 2.0, math.nan)]
    assert shown == ["0.50 ", "2.00!", ""]


@pytest.mark.slow
def test_the_command():
    """Picture, table on the terminal, and every figure in the CSV file."""
    result = call("bench", "stability", "--quick", "--csv", "all.csv")
    assert result.exit_code == 0, result.output
    assert "spectral radius" in result.stdout and result.stdout.endswith("stability.png\nall.csv\n")
    height, width, _ = matplotlib.image.imread("stability.png").shape
    assert width > 600 and height > 600
    with open("all.csv", newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == ["method", "figure", "scene", "value"]
    limit = "limit of p T, closed"
    found = {(row["method"], row["scene"]): row for row in table if row["figure"] == limit}
    assert float(found["rk4", "h/p = 0"]["value"]) == pytest.approx(2.0 * math.sqrt(2.0), rel=1e-14)
    assert float(found["newmark", "h/p = 2"]["value"]) == math.inf
    assert any(row["method"] == "newmark to the letter" for row in table)
    assert len(table) > 3 * len(INTEGRATORS) * 5 + 100


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "picture.jpg"], "must end in one of .png, .svg, .pdf"),
        (["-o", "nowhere/a.png"], "the folder nowhere of the picture a.png does not exist"),
        (["--csv", "nowhere/a.csv"], "the folder nowhere of the table a.csv does not exist"),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_is_measured(
    tmp_path, monkeypatch, arguments, words
):
    monkeypatch.setattr(stability, "limits", None)
    result = call("bench", "stability", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr and not list(tmp_path.iterdir())
