"""Checks of several keys together: the steps and their stability, what excludes what, the size."""

import numpy as np
import pytest
import yaml

from tests.helpers.configurations import load, oscillator_yaml, refusal
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.scheme import least_stable_steps


@pytest.mark.parametrize(
    ("values", "method", "steps"),
    [
        ({}, "impact: exact", 8),  # 2 pi (1.2 / 2 + 1) / 1.31
        ({"h": "[0.1, 2, 1]"}, "impact: exact", 17),
        ({"omega": "{start: 3, stop: 0.5, num: 4}", "p": "[1, 4]"}, "impact: exact", 46),
        ({}, "impact: plain", 100),
        ({}, "steps_per_period: 64", 64),
        ({}, "impact: plain, steps_per_period: 4", 4),
        ({}, "steps_per_period: ~", 8),
    ],
)
def test_the_steps_are_those_of_the_worst_point(values, method, steps):
    config = load(oscillator_yaml(**values) + f"method: {{{method}}}\n")
    assert LONGEST_STEP == 1.31  # that the numbers above are for
    assert config.method.steps_per_period == steps
    written = config.to_yaml()
    assert yaml.safe_load(written)["method"]["steps_per_period"] == steps
    assert load(written).method.steps_per_period == steps


@pytest.mark.parametrize(
    ("lines", "parts"),
    [
        ("method: {integrator: rk4}",
         ["line 2: method.integrator: impact exact needs the integrator exact, not rk4",
          "expected: integrator exact, or one of the impact rules plain, reduced-step, cubic"]),
        ("method: {steps_per_period: 7}",
         ["line 2: method.steps_per_period: 7 are not enough for exact impacts here",
          "an integer from 8 to 1,000,000, or null"]),
        ("method: {impact: cubic}\nrecord: {diagnostics: [period, lyapunov]}",
         ["line 3: record.diagnostics: lyapunov needs the impact rule exact, not cubic"]),
        ("record: {diagnostics: [perod]}",
         ["line 2: record.diagnostics[0] = perod is unknown (did you mean period?)",
          "period, lyapunov"]),
        ("record: {diagnostics: [period, period]}",
         ["record.diagnostics = [period, period] has a name twice"]),
        ("record: {diagnostics: period}", ["record.diagnostics = period is not allowed", "a list"]),
        ("method: {steps_per_period: 16}\nrecord: {periods: 1e6, trajectory: {every: 1}}",
         ["line 3: record.trajectory: 16,000,001 samples per point are too many",
          "at most 10,000,000"]),
    ],
)  # fmt: skip
def test_settings_that_do_not_go_together(lines, parts):
    message = refusal(oscillator_yaml() + lines + "\n")
    assert message.count("\n") == 0
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("values", "method", "parts"),
    [
        ({"h": "0.5", "omega": "0.5"}, "integrator: rk4, steps_per_period: 4",
         ["line 3: method.steps_per_period: 4 are not enough for rk4 to be stable at "
          "h = 0.5, p = 1, omega = 0.5: p T = 3.142 there must be below 2.623",
          "an integer from 5 to 1,000,000, null, or method.allow_unstable: true"]),
        # At neither end of h; the longest step is that of the least omega.
        ({"h": "[0, 0.54, 1]", "omega": "[1, 0.05]"}, "integrator: rk4, steps_per_period: 47",
         ["h = 0.54, p = 1, omega = 0.05: p T = 2.674 there must be below 2.616", "from 49 to"]),
        ({"p": "{start: 2, stop: 9, num: 3}"}, "integrator: verlet, steps_per_period: 14",
         ["p = 9, omega = 2: p T = 2.02 there must be below 2;", "an integer from 15 to"]),
        ({"h": "3", "p": "[1, 3.5, 2]"}, "integrator: euler, steps_per_period: 9",
         ["h = 3, p = 1, omega = 2: p T = 0.3491 there must be below 0.3431", "from 10 to"]),
        ({"h": "[1, 0]"}, "integrator: euler, steps_per_period: 1e6",
         ["line 3: method.integrator: euler is stable with no step at h = 0, p = 1, omega = 2",
          "expected: h > 0, one of semi-implicit-euler, verlet, newmark, rk4, exact, "
          "or method.allow_unstable: true"]),
        ({"h": "1e-7"}, "integrator: euler",
         ["euler is stable only from 1.57e+07 steps per period on, of 1,000,000 at most, "
          "at h = 1e-07, p = 1, omega = 2; expected: one of semi-implicit-euler, verlet"]),
        ({}, "integrator: euler, allow_unstable: 1",
         ["line 3: method.allow_unstable = 1 is neither true nor false"]),
    ],
)  # fmt: skip
def test_an_unstable_step_is_refused(values, method, parts):
    text = f"# a comment\n{oscillator_yaml(**values)}method: {{impact: plain, {method}}}\n"
    message = refusal(text)
    assert message.count("\n") == 0
    for part in parts:
        assert part in message
    assert load(text, "method.allow_unstable=True").method.allow_unstable is True


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_steps_are_stable_all_over_the_grid_and_no_more_than_needed(integrator):
    """Against every point of random grids, below, across and above critical damping."""
    rng = np.random.default_rng(6)
    for _ in range(15):
        ends = rng.exponential(1.0, 2) + 0.01, rng.exponential(1.0, 2) + 0.01
        h, p = (f"{{start: {a!r}, stop: {b!r}, num: 41}}" for a, b in np.array(ends).tolist())
        text = oscillator_yaml(h=h, p=p, omega="[0.01, 0.007]")
        text += f"method: {{integrator: {integrator}, impact: plain}}\n"
        config = load(text, "method.allow_unstable=true")
        mesh = np.meshgrid(config.sweep.grid.axes["h"], config.sweep.grid.axes["p"])
        least = least_stable_steps(integrator, *mesh, 0.007).max()
        assert config.method.steps_per_period == max(100, least) if least <= 1e6 else 100
        if 4 < least <= 1e6:
            load(text, f"method.steps_per_period={least:.0f}")
            message = refusal(text, [f"method.steps_per_period={least - 1:.0f}"])
            assert f"expected: an integer from {least:,.0f} to" in message


@pytest.mark.parametrize("values", [{"omega": "1e-9"}, {"omega": "1e-300"}, {"h": "1e308"}])
def test_more_steps_than_can_be_computed(values):
    message = refusal("# a comment\n" + oscillator_yaml(**values))
    assert "line 2: oscillator.omega: exact impacts would need" in message
    assert "at most 1,000,000" in message and message.count("\n") == 0


def test_a_grid_that_is_too_large():
    axis = "{start: 0, stop: 1, num: 1e3}"
    assert load(oscillator_yaml(h=axis, R=axis, f=axis)).sweep.grid.size == 10**9
    message = refusal("# a comment\n" + oscillator_yaml(h=axis, R=axis, f=axis, p="[1, 2]"))
    assert "line 2: oscillator.h: the axes make a grid of 2,000,000,000 points" in message
    assert "at most 1,000,000,000" in message


def test_all_conflicts_are_told_at_once():
    text = oscillator_yaml() + "method: {integrator: euler}\nrecord: {longest: 500}\n"
    first, second = refusal(text).splitlines()
    assert "line 2: method.integrator: impact exact needs the integrator exact" in first
    assert "line 3: record.longest: is only for transient: auto" in second
