"""Distinct attractors against published speeds, long runs, symmetries, and pair by pair."""

import numpy as np
import pytest

from sweeps import attractors
from sweeps.attractor import tracking
from sweeps.attractor.attractor_table import attractor_report, attractor_rows
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.commands import call
from tests.helpers.motions import partition
from tests.helpers.sweep_files import swept
from vibroimpact import Oscillator, one_impact_orbit
from vibroimpact.points.regimes import Regime
from vibroimpact.status import Status

pytestmark = pytest.mark.slow


def rows_of(dataset):
    return attractor_rows(OpenedSweep(dataset), attractors(dataset))


def test_the_rest_position_is_the_attractor_where_there_is_no_force():
    """The free oscillation, 1/0, shrinks to this state with the force."""
    record = {"transient": 50, "periods": 32, "diagnostics": ["period"]}
    oscillator = {"h": 0.1, "R": 0.8, "omega": 2.6, "f": [0.0, 0.1], "clearance": 0.3}
    dataset = swept({"oscillator": oscillator, "start": {"x0": -0.4}, "record": record})
    assert dataset["orbit_distance"].values[0] > 1e-6  # 50 periods reduce 0.4 to 2e-6 only
    found = attractors(dataset)
    np.testing.assert_array_equal(found["m"].values, [[1], [1]])
    np.testing.assert_array_equal(found["q"].values, [[0], [0]])
    assert np.abs(found["section_x"].values[0]).max() < 1e-15


def test_the_known_coexisting_attractors(computed_starts):
    """Those without damping are in the scene ``basins``."""
    dataset = computed_starts("oscillator.h=0.02", "oscillator.R=0.95", "record.transient=1500")
    found = attractors(dataset)
    assert found["attractors"].item() == 2
    by_class = {row.name: row for row in attractor_rows(OpenedSweep(dataset), found)}
    assert set(by_class) == {"1/1", "2/3"}
    np.testing.assert_allclose(by_class["2/3"].speeds, (0.7642, 0.9341, 2.1229), atol=1e-4)
    exact = one_impact_orbit(Oscillator(h=0.02, R=0.95, omega=1.3, f=1.0)).v
    np.testing.assert_allclose(by_class["1/1"].speeds, [exact], rtol=1e-5)
    assert found["fraction"].sum().item() == pytest.approx(1.0)


@pytest.mark.parametrize(
    "record",
    [
        ["record.transient=1500", "record.impacts=3"],
        ["record.transient=1500", "record.impacts=200"],
        ["record={transient: 0, periods: 2, impacts: 1, diagnostics: [period]}"],
    ],
)
def test_speeds_are_shown_whatever_room_the_record_has(computed_starts, record):
    """In 32 periods the orbits have 32 and 48 impacts, the rest is padding; in two none settles."""
    dataset = computed_starts(*record)
    by_class = {row.name: row.speeds for row in rows_of(dataset)}
    np.testing.assert_allclose(by_class["1/1"], [1.4225], atol=1e-4)
    np.testing.assert_allclose(by_class["2/3"], (0.7030, 1.1145, 2.2536), atol=1e-4)


SLOW = (
    "oscillator={h: 0.02, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}",
    "start={x0: {start: -3.0, stop: 0.6, num: 12}, v0: {start: -3.0, stop: 3.0, num: 12}}",
    "record={transient: 200, periods: 32, impacts: 16, diagnostics: [period]}",
)


def test_starts_that_settle_slowly_are_on_the_attractor_they_go_to(computed_starts):
    """Without impacts a deviation falls by exp(-2 pi h / omega) = 0.953 per period."""
    dataset = computed_starts(*SLOW)
    slow = dataset["orbit_distance"].values > 1e-6
    assert 0.1 < slow.mean() < 0.5 and (dataset["impacts_per_period"].values[slow] == 0.0).all()
    found = attractors(dataset)
    assert {row.name for row in attractor_rows(OpenedSweep(dataset), found)} >= {"1/0", "2/1"}
    assert not (found["motion"] == Regime.UNKNOWN).any()
    (free,) = (row for row in attractor_rows(OpenedSweep(dataset), found) if row.name == "1/0")
    assert (found["attractor"].values[slow] == free.number).all()
    np.testing.assert_array_equal(found["followed"], slow)
    long = computed_starts(*SLOW, "record.transient=4000")
    assert not attractors(long, extensions=0)["followed"].any()
    assert partition(found["attractor"]) == partition(attractors(long, extensions=0)["attractor"])


@pytest.mark.parametrize(("transient", "starts"), [(340, (9, 7, 3)), (300, (10, 6, 0))])
def test_an_attractor_has_a_start_whose_record_shows_it(computed_starts, transient, starts):
    """Tables and pictures show the record of the representative."""
    x0, *v0 = starts
    slow = computed_starts(*SLOW, f"record.transient={transient}")
    found = attractors(slow.isel(x0=[x0], v0=v0))
    assert found["followed"].values.ravel().tolist() == [False, True]
    assert found["attractor"].values.ravel().tolist() == [0, 0]
    assert found["from_record"].all() and found["representative"].item() == 0


def test_the_table_says_which_share_was_followed_on(computed_starts):
    result = call("attractors", computed_starts(*SLOW).encoding["source"])
    slow = (computed_starts(*SLOW)["orbit_distance"].values > 1e-6).mean()
    assert f"{100 * slow:.1f} % of the starts were followed beyond their record" in result.stdout
    assert "unknown" not in result.stdout


RARE_REST = (
    "oscillator={h: 0.005, R: 0.7401630021937817, omega: 2.9338359090754915, f: 1.0}",
    "oscillator={h: 0.03, R: 0.7590710327355209, omega: 2.250795135660626, f: 1.0, "
    "clearance: 0.2315274078175349}",
)


LONG, OWN = "transient: 200, periods: 100", "transient: auto, longest: 3000, periods: 32"


@pytest.mark.parametrize(
    ("oscillator", "length", "diagnostics", "most"),
    [
        (RARE_REST[0], LONG, "period", tracking.MOST_CONTINUED),
        (RARE_REST[1], LONG, "period, lyapunov", tracking.MOST_CONTINUED),
        (RARE_REST[0], OWN, "period, lyapunov", tracking.MOST_CONTINUED),
        (RARE_REST[1], OWN, "period, lyapunov", 144 * 2000),
    ],
)
def test_chaos_that_rests_now_and_then_is_one_attractor(
    computed_starts, monkeypatch, oscillator, length, diagnostics, most
):
    """Over 62,600 periods every start rests: once in about 1000 periods, and in 300."""
    monkeypatch.setattr(tracking, "MOST_CONTINUED", most)
    dataset = computed_starts(
        oscillator,
        "start={x0: {start: -2.5, stop: 0.0, num: 12}, v0: {start: -2.0, stop: 2.0, num: 12}}",
        f"record={{{length}, diagnostics: [{diagnostics}]}}",
    )
    records = attractors(dataset, extensions=0)["motion"].values
    assert (records >= 0).sum() > 1
    found = attractors(dataset)
    assert found["motion"].values[found["fraction"] > 0].tolist() == [Regime.REST]
    assert found["attractors"].item() == 1 and found["m"].max() == 0


def test_chaos_that_is_a_transient_at_every_start_is_followed_to_its_end(
    computed_starts, monkeypatch
):
    """The 1/1 orbit is the only attractor: so it is for 400 starts after 60,000 periods."""
    dataset = computed_starts(
        "oscillator={h: 0.01611560153114556, R: 0.9061284858601972, omega: 2.6038931678803925, "
        "f: 1.0}",
        "start={x0: {start: -2.5, stop: 0.0, num: 12}, v0: {start: -2.0, stop: 2.0, num: 12}}",
        "record={transient: 50, periods: 32, diagnostics: [period, lyapunov]}",
    )
    records = attractors(dataset, extensions=0)
    chaotic = records["motion"].values == Regime.CHAOTIC
    states, last = records["section_x"].values[chaotic], dataset["poincare_x"].values[..., -1]
    assert chaotic.any() and np.isin(states, last).all()
    # Some end soon: of the others it is not known whether they stay chaotic.
    assert Regime.CHAOTIC not in attractors(dataset, extensions=1)["motion"]
    assert [row.name for row in rows_of(dataset)] == ["1/1"]
    monkeypatch.setattr("sweeps.attractor.tracking.MOST_CONTINUED", 0)
    found = attractors(dataset)
    assert found.equals(records) and found.attrs["left_out"] == 4 and records.attrs["left_out"] == 0
    told = attractor_report(OpenedSweep(dataset), found, rows_of(dataset))
    assert "300,000,000 forcing periods: 4 of 4 extensions left out" in told


def test_weak_chaos_is_not_the_orbit_that_it_is_near(computed_starts):
    """400 starts over 60,000 periods show 3/3, 1/1, two starts on 48/48, and chaos."""
    dataset = computed_starts(
        "oscillator={h: 0.006570030348489509, R: 0.8763616852795647, omega: 2.575959283090773, "
        "f: 1.0}",
        "start={x0: {start: -2.5, stop: 0.0, num: 20}, v0: {start: -2.0, stop: 2.0, num: 20}}",
        "record={transient: 200, periods: 100, diagnostics: [period, lyapunov]}",
    )
    shares = {row.name: row.fraction for row in rows_of(dataset)}
    counts = {"3/3": 306, "1/1": 64, "48/48": 2, "chaotic": 28}
    assert {name: 400 * share for name, share in shares.items()} == pytest.approx(counts)


def test_a_motion_that_fails_while_it_is_followed_has_no_attractor():
    """Without damping Euler overflows after 1,500 periods, in the middle of the extension."""
    dataset = swept("""
oscillator: {h: 0, R: 1, omega: 1.3, f: 1.0}
start: {x0: [-1, -1.001]}
method: {integrator: euler, impact: plain, steps_per_period: 20, allow_unstable: true}
record: {transient: 100, periods: 500}
""")
    assert (dataset["status"] == Status.COMPUTED).all() and (dataset["period"] == 0).all()
    found = attractors(dataset, extensions=1)
    assert found["followed"].all() and (found["attractor"] == -1).all()


def test_the_order_of_the_starts_changes_names_only(computed_starts):
    dataset, random = computed_starts(), np.random.default_rng(1)
    order = {name: random.permutation(dataset.sizes[name]) for name in ("x0", "v0")}
    turned = dataset.isel(order).transpose("v0", "x0", ...)
    found, other = attractors(dataset), attractors(turned)
    turned = other["attractor"].transpose("x0", "v0")
    np.testing.assert_array_equal(turned, found["attractor"].isel(order))
    np.testing.assert_allclose(other["fraction"], found["fraction"])
    np.testing.assert_allclose(other["m"], found["m"])
