"""The paper's cases, measured: against what is known of them, and as table and picture."""

import math
from pathlib import Path

import numpy as np
import pytest

from commands import call
from sweeps.bench import paper
from sweeps.bench.paper_picture import picture

# Known of the three cases: impacts per period, their speeds, and the order to the letter, which
# the acceleration of eq. (10) costs where h > 0.
KNOWN = {
    "conservative impacts": (2, (0.902040564502884, 0.411362031140622), 1),
    "conservative inter-impact motion": (2, (2.037529035119366, 0.811704646702102), 2),
    "fully dissipative": (4, (0.907496491171004, 0.036454221377120), 1),
}


@pytest.fixture(scope="module")
def measured():
    """What is measured on a short ladder."""
    return paper.measure(ladder=(400, 800, 1600), spread=4, stalling=(100, 10_000))


@pytest.mark.slow
@pytest.mark.parametrize("name", KNOWN)
def test_the_claim_and_the_orders(measured, name):
    case, (impacts, speeds, order) = measured.cases.loc[name], KNOWN[name]
    assert case.impacts["exact"] == case.impacts["with"] == impacts * paper.PERIODS
    deepest = 1.3 * max(speeds) * 2.0 * math.pi / paper.STEPS  # the first impact is the fastest
    assert 0.3 * deepest < case.deepest["without"] < deepest
    assert case.deepest["with"] == case.deepest["to the letter"] == 0.0
    assert case.order["without"] == pytest.approx(1, abs=0.25)
    assert case.order["with"] == pytest.approx(2, abs=0.25)
    assert case.order["to the letter"] == pytest.approx(order, abs=0.25)


def test_an_impact_is_lost_without_the_procedure_and_to_the_letter(measured):
    counts = measured.cases.loc["fully dissipative"].impacts
    assert counts.to_dict() == {"without": 60, "with": 80, "to the letter": 60, "exact": 80}


def test_the_stall_is_before_the_end_of_the_chatter(measured):
    end = measured.chatter.rests[0, 0]
    assert end == pytest.approx(12.41264, abs=5e-6)
    assert measured.stalls[100].stalled_at == pytest.approx(12.114, abs=5e-4)
    assert measured.stalls[10_000].stalled_at == pytest.approx(12.4103, abs=5e-5)


def test_who_resolves_the_fourth_impact(measured):
    """Its speed is known to 15 digits; every order 2 with a reduced step finds it."""
    assert measured.resolved["exact", "exact"] == (
        4.0,
        pytest.approx(KNOWN["fully dissipative"][1][1], rel=1e-9),
    )
    for integrator, rule in measured.resolved:
        second = integrator not in ("euler", "semi-implicit-euler")
        assert measured.resolves(integrator, rule) == (rule != "plain" and second)


def test_an_impact_that_never_comes_is_an_infinite_error():
    """To the letter the chatter stalls after two impacts."""
    errors = paper._errors("to the letter", paper.CHATTER, (100,), 1, paper.simulate(paper.CHATTER))
    assert errors[0] == np.inf


def test_the_tables_have_the_numbers(measured):
    text = paper.tables(measured)
    for part in ("0.042", "0.078", "0.043", "12.41264", "12.11439", "0.0365*", " 60 "):
        assert part in text
    assert max(map(len, text.splitlines())) <= 100


def test_the_picture_shows_what_was_measured(measured):
    panels = picture(measured).axes
    assert len(panels) == 8
    for panel, name in zip(panels[1:6:2], KNOWN, strict=True):
        for line, errors in zip(panel.lines, measured.cases.loc[name].errors.dropna(), strict=True):
            np.testing.assert_array_equal(line.get_xdata(), measured.ladder)
            np.testing.assert_array_equal(line.get_ydata(), errors)
    written = " ".join(text.get_text() for text in panels[7].texts)
    assert written.count("4\n0.036") >= 6 and "3\n0.108" in written


@pytest.mark.slow
def test_the_command(measured, monkeypatch):
    monkeypatch.setattr("sweeps.bench.paper.measure", lambda: measured)
    done = call("bench", "paper")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "paper.png" and "12.41264" in done.stdout
    assert Path("paper.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_that_cannot_be_written_is_refused_before_anything_is_measured(monkeypatch):
    monkeypatch.setattr("sweeps.bench.paper.measure", None)
    refused = call("bench", "paper", "-o", "a.jpg")
    assert refused.exit_code == 2 and refused.stdout == ""
    assert refused.stderr.startswith("vibroimpact: error: a.jpg must end in one of .png")
