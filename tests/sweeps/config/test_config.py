"""The configuration: reading, overriding, writing, and its JSON schema."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml

from sweeps.config.groups import STARTS, OscillatorConfig
from sweeps.config.json_schema import json_schema
from sweeps.config.loading import load_config
from sweeps.config.values import Range
from sweeps.errors import ConfigError
from tests.helpers.configurations import EXAMPLE, linear_values, load, oscillator_yaml, refusal
from tests.helpers.places import CONFIGS
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.scheme import IMPACT_RULES, least_stable_steps

# Reading


def test_a_mapping_is_read_as_its_yaml():
    typed = load(EXAMPLE)
    data = yaml.safe_load(EXAMPLE)
    assert load_config(data) == typed
    assert load_config(data, ["oscillator.h=0.3"]).oscillator.h == 0.3
    assert data["oscillator"]["h"] == 0.1
    values = np.linspace(0.8, 4.0, 5)
    data["oscillator"] |= {"omega": values, "R": np.float64(0.7)}
    data["record"]["periods"] = np.int64(7)
    config = load_config(data)
    assert config.oscillator.omega == tuple(values)
    assert (config.oscillator.R, config.record.periods) == (0.7, 7)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_file_is_read_in_every_encoding_that_its_first_bytes_tell(encoding):
    """PowerShell writes the output of a command in UTF-16."""
    Path("small.yaml").write_bytes(f"name: größe\r\n{oscillator_yaml()}".encode(encoding))
    assert load_config("small.yaml").name == "größe"


def test_a_mapping_that_cannot_be():
    with pytest.raises(ConfigError) as caught:
        load_config({"oscillator": {"h": 0.1, "R": 1.2, "omega": np.arange(3.0), "f": 1, "gap": 1}})
    first, second, third = str(caught.value).splitlines()
    assert first.startswith("the configuration: oscillator.R = 1.2 is not allowed; expected: ")
    assert "oscillator.omega = [0.0, 1.0, 2.0] contains 0, which is not allowed" in second
    assert "unknown key oscillator.gap (did you mean clearance?)" in third


CYCLIC: dict = {"h": 0.1}
CYCLIC["R"] = [CYCLIC]


@pytest.mark.parametrize(
    ("source", "overrides", "part"),
    [
        ({1: 2}, [], "unknown key 1 ("),
        (
            {"oscillator": {(1, 2): 3}},
            [],
            "unknown key oscillator.(1, 2); expected: a mapping",
        ),
        ({"oscillator": CYCLIC}, [], "the configuration: more than 16 levels are not allowed"),
        (None, [], "the configuration is None; expected: a YAML file, or a mapping with keys"),
        (
            ["oscillator"],
            [],
            "the configuration is ['oscillator']; expected: a YAML file, or",
        ),
        ({}, [1], "override 1: expected key=value, for example oscillator.h=0.2"),
        ({}, "name=a", "overrides = 'name=a'; expected: a list of texts key=value"),
        ({}, None, "overrides = None; expected: a list of texts key=value"),
    ],
)
def test_arguments_that_are_no_configuration(source, overrides, part):
    with pytest.raises(ConfigError) as caught:
        load_config(source, overrides)
    assert part in str(caught.value)


def test_the_example_is_read_as_written():
    config = load(EXAMPLE)
    assert (config.name, config.output) == ("frequency-bifurcation", Path("results/frequency.h5"))
    assert (config.method.integrator, config.method.impact) == ("exact", "exact")
    assert config.record.trajectory is False
    assert list(config.sweep.grid.axes) == ["omega"]
    np.testing.assert_array_equal(config.sweep.grid.axes["omega"], linear_values(0.8, 4.0, 4096))
    assert config.sweep.grid.fixed == {
        "h": 0.1, "R": 0.8, "f": 1.0, "p": 1.0, "clearance": 0.0, "a": 0.0, "x0": 0.0, "v0": 0.0,
        "phase": 0.0,
    }  # fmt: skip


def test_the_defaults_are_the_documented_ones():
    config, example = load(oscillator_yaml()), load(EXAMPLE)
    assert (config.name, config.output) == ("sweep", Path("sweep.h5"))
    for group in ("start", "method", "record"):
        given = getattr(example, group)
        chosen = {"steps_per_period"}  # for the oscillator, where none are given
        assert getattr(config, group).model_dump(exclude=chosen) == given.model_dump(exclude=chosen)
    assert config.sweep.grid.axes == {}
    for name, parameter in PARAMETERS.items():
        if parameter.default is not None:
            assert config.sweep.grid.fixed[name] == parameter.default


@pytest.mark.parametrize(
    ("text", "axes"),
    [
        ("start: {v0: [1, 2], x0: [-1]}\noscillator: {f: 1, R: [1], h: 0, omega: [1, 2]}\n",
         ["v0", "x0", "R", "omega"]),
        ("oscillator: {omega: [1], f: 1, R: [1], h: 0}\nstart: {x0: [-1], v0: 0}\n",
         ["omega", "R", "x0"]),
    ],
)  # fmt: skip
def test_the_axes_are_in_the_order_of_the_file(text, axes):
    config = load(text)
    assert list(config.sweep.grid.axes) == axes
    assert config.sweep.grid.shape == tuple(
        len(values) for values in config.sweep.grid.axes.values()
    )


def test_one_value_in_a_list_or_range_is_an_axis():
    axes = load(oscillator_yaml(h="[0.3]", f="{start: 2, stop: 2, num: 1}")).sweep.grid.axes
    assert {name: list(values) for name, values in axes.items()} == {"h": [0.3], "f": [2.0]}


@pytest.mark.parametrize(("first", "last"), [(-4, 0), (3, -3), (-300, 300)])
def test_decades_of_a_log_axis_are_exact(first, last):
    powers = range(first, last + 1) if first < last else range(first, last - 1, -1)
    decades = [float(f"1e{power}") for power in powers]
    axis = Range(start=decades[0], stop=decades[-1], num=len(decades), spacing="log")
    assert axis.values().tolist() == decades


def test_a_log_axis_is_rounded_correctly():
    """So its bits are the same everywhere: no other number is nearer to the geometric series."""
    values = Range(start=0.3, stop=7.1, num=40, spacing="log").values().tolist()
    start, stop, last = Fraction("0.3"), Fraction("7.1"), len(values) - 1
    for i, value in enumerate(values):
        low, high = (
            (Fraction(value) + Fraction(math.nextafter(value, end))) / 2 for end in (0.0, math.inf)
        )
        assert low**last <= start ** (last - i) * stop**i <= high**last


def test_a_linear_axis_has_the_numbers_that_are_typed():
    for start, stop, num in ((0.1, 1, 10), (2.4, 3.5, 111), (-0.3, 0.3, 7), (1e-3, 0.2, 200)):
        text = f"{{start: {start}, stop: {stop}, num: {num}}}"
        config = load(oscillator_yaml(clearance=text) + "start: {x0: -1}\n")
        values = config.sweep.grid.axes["clearance"]
        assert values.tolist() == [float(f"{value:.3g}") for value in values]


ENDS = [
    (-0.3, 0.7),
    (1 / 3, math.pi),
    (1e308, -1e308),
    (0.0, 5e-324),
    (-1e-300, 1.0),
    (5.5e17, 2.5),
]


@pytest.mark.parametrize("num", [2, 10, 999, 40_000])
@pytest.mark.parametrize(("start", "stop"), ENDS)
def test_a_linear_axis_is_rounded_correctly(start, stop, num):
    """Few values, and more than are computed one by one; by rational numbers."""
    values = Range.model_construct(start=start, stop=stop, num=num, spacing="linear").values()
    assert (values[0], values[-1]) == (start, stop)
    first, rise = Fraction(repr(start)), Fraction(repr(stop)) - Fraction(repr(start))
    for i in range(0, num, max(1, num // 97)):
        assert values[i] == float(first + rise * i / (num - 1))


@pytest.mark.parametrize(
    ("start", "stop"), [(0.3, 7.1), (1e300, 1e-300), (5e-324, 1.0), (1.0, 2.0)]
)
def test_many_values_of_a_log_axis_are_rounded_correctly(start, stop):
    """More values than are computed one by one, by 60 digits."""
    num = 40_001
    values = Range(start=start, stop=stop, num=num, spacing="log").values()
    assert (values[0], values[-1]) == (start, stop)
    with localcontext(prec=60):
        first = Decimal(repr(start))
        growth = (Decimal(repr(stop)) / first).ln() / (num - 1)
        for i in range(0, num, 401):
            assert values[i] == float(first * (i * growth).exp())


@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_no_value_of_a_range_is_rounded_out_of_it(spacing):
    low = math.nextafter(1.0, 0.0)
    text = f"{{start: {low!r}, stop: 1, num: 50, spacing: {spacing}}}"
    values = load(oscillator_yaml(R=text)).sweep.grid.axes["R"]
    assert values.max() == 1.0 and values.min() == low


@pytest.mark.parametrize(
    ("text", "ends", "swept", "values"),
    [
        ("0.3", (0.3, 0.3, 0.3), False, [0.3]),
        ("[0.3]", (0.3, 0.3, 0.3), True, [0.3]),
        ("[0.5, 0.7, 0.25]", (0.25, 0.25, 0.7), True, [0.25, 0.5, 0.7]),
        ("[0.7, 0.5, 0.25]", (0.7, 0.25, 0.7), True, [0.7, 0.5, 0.25]),
        ("{start: 1, stop: 0, num: 3}", (1.0, 0.0, 1.0), True, [1.0, 0.5, 0.0]),
        ("{start: 1, stop: 1, num: 1}", (1.0, 1.0, 1.0), True, [1.0]),
    ],
)
def test_an_axis_has_the_values_of_every_form(text, ends, swept, values):
    axis = load(oscillator_yaml(R=text)).parameters()["R"]
    assert (axis.first, axis.low, axis.high) == ends
    assert (axis.size, axis.swept, axis.values().tolist()) == (len(values), swept, values)


def test_the_values_of_a_long_range_are_not_created_before_they_are_needed(monkeypatch):
    created = []
    values = Range.values
    monkeypatch.setattr(Range, "values", lambda self: created.append(self.num) or values(self))
    long = "{start: 1, stop: 2, num: 1e7}"
    for name in ("omega", "f", "p", "clearance"):
        assert load(oscillator_yaml(**{name: long})).parameters()[name].size == 10**7
    assert "beyond the stop" in refusal(oscillator_yaml() + f"start: {{x0: {long}}}\n")
    assert "20,000,000,000 points" in refusal(
        oscillator_yaml(f=long, R="{start: 0, stop: 1, num: 2e3}")
    )
    assert not created
    config = load(oscillator_yaml(f="{start: 1, stop: 2, num: 7}"))
    assert config.size == 7 and created == [7]


def test_configurations_are_equal_whatever_was_computed_of_them():
    one, other = load(EXAMPLE), load(EXAMPLE)
    assert one.size == 4096 and one == other == load(EXAMPLE, "record.phase=0")
    assert one != load(EXAMPLE, "record.periods=99")
    start = "start: {v0: [1, 2], x0: [-1, -2]}\n"
    assert load(oscillator_yaml() + start) != load(
        start + oscillator_yaml()
    )  # another order of the axes
    with pytest.raises(ValueError, match="frozen"):
        one.record.periods = 3


@pytest.mark.parametrize("text", ["1e-3", "'1e-3'", "1E-3", "+.001", "0.001"])
def test_numbers_are_read_however_they_are_written(text):
    assert load(oscillator_yaml(h=text)).oscillator.h == 1e-3


def test_every_integrator_and_impact_rule_is_accepted():
    for integrator in INTEGRATORS:
        for impact in IMPACT_RULES:
            if impact != "exact" or integrator == "exact":
                method = f"method: {{integrator: {integrator}, impact: {impact}}}\n"
                assert load(oscillator_yaml() + method).method.impact == impact


@pytest.mark.parametrize(
    ("values", "method", "steps"),
    [
        ({}, "impact: exact", 8),  # 2 pi (1.2 / 2 + 1) / 1.31
        ({"h": "[0.1, 2, 1]"}, "impact: exact", 17),
        ({"omega": "{start: 3, stop: 0.5, num: 4}", "p": "[1, 4]"}, "impact: exact", 46),
        ({}, "impact: plain", 100),
        ({"omega": "1e-9"}, "impact: cubic", 100),
        ({}, "steps_per_period: 64", 64),
        ({}, "steps_per_period: 16", 16),
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
        ({"h": "[1, 0]"}, "integrator: euler",
         ["line 3: method.integrator: euler is stable with no step"]),
        ({"h": "1e-7"}, "integrator: euler",
         ["euler is stable only from 1.57e+07 steps per period on, of 1,000,000 at most, "
          "at h = 1e-07, p = 1, omega = 2; expected: one of semi-implicit-euler, verlet"]),
        ({"p": "1e9"}, "integrator: rk4",
         ["rk4 is stable only from 1.11e+09 steps", "expected: one of newmark, exact, or method."]),
        ({}, "integrator: euler, allow_unstable: maybe",
         ["line 3: method.allow_unstable = maybe is neither true nor false"]),
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
    for _ in range(30):
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


# --set


def test_overrides_replace_and_add_in_order():
    overrides = [
        "oscillator.h=0.2",
        "oscillator.omega.num=7",
        "start.v0=[1, 2]",
        "record.trajectory={every: 2}",
        "name=renamed",
    ]
    config = load(EXAMPLE, *overrides)
    assert config.oscillator.h == 0.2
    assert config.sweep.grid.shape == (7, 2)
    assert config.record.trajectory and config.record.trajectory.every == 2
    assert config.name == "renamed"


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("oscillator.R=1.2", ["oscillator.R = 1.2", "from 0 to 1"]),
        ("oscilator.h=1", ["unknown key oscilator", "did you mean oscillator?"]),
        ("oscillator.omga=1", ["oscillator.omga", "did you mean omega?", "clearance"]),
        ("oscillator.h.num=2", ["oscillator.h = 0.1 has no keys"]),
        ("oscillator.h=[1,", ["not valid YAML"]),
        ("oscillator.h", ["expected key=value"]),
        ("oscillator.h=", ["oscillator.h = (nothing) is not a number"]),
        ("oscillator.h=0,1", ["oscillator.h = 0,1 has a decimal comma", "decimal point, no comma"]),
        (
            "oscillator={h: 0,1, R: 1}",
            ["unknown key oscillator.1 (", "decimal point, no comma"],
        ),
        (
            "record.trajectory={ever: 2}",
            ["record.trajectory.ever (did you mean every?)"],
        ),
        ("record.trajectory={}", ["record.trajectory.every is missing"]),
        ("=", ["expected key=value"]),
        ("..x=1", ["expected key=value"]),
        ("a..b=1", ["expected key=value"]),
        ("<scalar>=1", ["unknown key <scalar>"]),
    ],
)
def test_a_wrong_override_is_reported_as_one(override, parts):
    message = refusal(EXAMPLE.replace("false", "{every: 1}"), [override])
    for line in message.splitlines():
        assert line.startswith(f"override {override}")
    for part in parts:
        assert part in message


# to_yaml


@pytest.mark.parametrize(
    "text",
    [
        EXAMPLE,
        oscillator_yaml(),
        "start: {v0: [1, 2]}\nrecord: {trajectory: {every: 3}}\n"
        "oscillator: {f: 1, R: 1, h: {start: 1e-7, stop: 1, num: 9, spacing: log}, omega: .1}\n"
        "name: 'on'\n",
        f"name: '1.0'\n{oscillator_yaml(h='0.30000000000000004', f='[1e22, 3]')}",
        f"compression: gzip\n{oscillator_yaml()}",
    ],
)
def test_to_yaml_round_trip(text):
    config = load(text)
    written = config.to_yaml()
    again = load(written)
    assert again.to_yaml() == written
    assert list(again.sweep.grid.axes) == list(config.sweep.grid.axes)
    for name, values in config.sweep.grid.axes.items():
        np.testing.assert_array_equal(again.sweep.grid.axes[name], values)
    assert again.sweep.grid.fixed == config.sweep.grid.fixed
    left_out = {"output": True, "method": {"steps_per_period"}}
    assert again.model_dump(exclude=left_out) == config.model_dump(exclude=left_out)
    assert again.method.steps_per_period == config.method.steps_per_period


def test_to_yaml_is_complete_and_keeps_the_order():
    plain = yaml.safe_load(load("start: {v0: 1}\n" + oscillator_yaml()).to_yaml())
    assert list(plain) == ["name", "start", "oscillator", "method", "record", "compression"]
    assert list(plain["start"]) == ["v0", "x0", "phase"]
    assert plain["record"] == {
        "transient": 1000, "periods": 100, "phase": 0.0, "impacts": 64, "trajectory": False,
        "diagnostics": ["period"],
    }  # fmt: skip


# The JSON schema


def test_the_schema_accepts_the_example_and_refuses_a_wrong_one():
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    texts = [EXAMPLE, *(path.read_text() for path in CONFIGS.glob("**/*.yaml"))]
    for text in texts:
        validator.validate(yaml.safe_load(text))
    for wrong in (
        "record: {periods: 0}\n",
        "record: {diagnostics: [speed]}\n",
        "method: {integrator: euclid}\n",
        "method: {steps_per_period: 3}\n",
        "hh: 1\n",
    ):
        assert not validator.is_valid(yaml.safe_load(oscillator_yaml() + wrong))
    assert not validator.is_valid(yaml.safe_load("oscillator: {h: 1}\n"))


EDGES = (-1.0, -5e-324, 0.0, 5e-324, 0.5, 1.0, 1.0000000000000002, 1.2, 1e300)


@pytest.mark.parametrize("form", ["{v}", "[0.25, {v}]", "{{start: 0.5, stop: {v}, num: 2}}",
                                  "{{start: {v}, stop: 0.5, num: 2}}"])  # fmt: skip
@pytest.mark.parametrize("name", [*OscillatorConfig.model_fields, *STARTS])
def test_the_schema_has_the_bounds_of_every_parameter(name, form):
    """An editor marks a number exactly where the parameter does not allow it."""
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    assert {"$schema", "$id"} < {*schema}
    validator = jsonschema.Draft202012Validator(schema)
    for value in EDGES:
        given = form.format(v=f"{value:.17e}")
        text = oscillator_yaml(**{name: given} if name in OscillatorConfig.model_fields else {})
        text += f"start: {{{name}: {given}}}" if name in STARTS else ""
        assert validator.is_valid(yaml.safe_load(text)) == PARAMETERS[name].accepts(value), text


def test_the_schema_describes_every_parameter():
    definitions = json_schema()["$defs"]
    properties = {
        **definitions["OscillatorConfig"]["properties"],
        **definitions["StartConfig"]["properties"],
    }
    for name, parameter in PARAMETERS.items():
        description = properties[name]["description"]
        assert parameter.meaning in description
        assert (f"[{parameter.unit}]" in description) == (parameter.unit != "1")
        assert parameter.allowed in description


# A shaken base or an unbalance


def test_a_base_takes_the_place_of_the_force_or_adds_to_it():
    """As a number, an axis or a column; without f the force is the base's alone."""
    base = load("oscillator: {h: 0.1, R: 0.8, omega: 2, a: [0, 0.5]}\n").sweep.grid
    assert base.fixed["f"] == 0.0 and base.axes["a"].tolist() == [0.0, 0.5]
    both = load("oscillator: {h: 0.1, R: 0.8, omega: 2, a: 0.5, f: 3}\n").sweep.grid
    assert (both.fixed["f"], both.fixed["a"]) == (3.0, 0.5)
    table = "points: {omega: [1, 2], a: [0.5, 0.25]}\noscillator: {h: 0.1, R: 0.8}\n"
    points = load(table).sweep.grid.points((slice(0, 2),))
    assert points["a"].tolist() == [0.5, 0.25] and points["f"].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("oscillator: {h: 0, R: 1, omega: 2}\n", "oscillator.f is missing; expected: "),
        ("oscillator: {h: 0, R: 1, omega: 2, a: 0}\n", "oscillator.f is missing; expected: "),
        ("oscillator: {h: 0, R: 1, omega: 2, a: -0.0e+3}\n", "oscillator.f is missing; expected: "),
        ("oscillator: {h: 0, R: 1, omega: 2, a: [0]}\n", "oscillator.f is missing; expected: "),
        ("oscillator: {h: 0, R: 1, omega: 2, a: {start: 0, stop: 0, num: 1}}\n",
         "oscillator.f is missing; expected: "),
        ("points: {omega: [1, 2], a: [0, 0]}\noscillator: {h: 0, R: 1}\n",
         "points.a: is 0 in every row, and there is no f; expected: oscillator.f, a column f"),
        ("oscillator: {h: 0, R: 1, omega: 2, a: -1}\n", "oscillator.a = -1 is not allowed"),
        ("oscillator: {h: 0, R: 1, omega: [1, 1.0e+200], a: 1}\n", "oscillator.a: the force f + a"),
        ("points: {omega: [1, 1.0e+200], a: [0, 1]}\noscillator: {h: 0, R: 1}\n",
         "oscillator.a: row 2 of points: the force f + a omega^2 must be a finite number"),
        ("oscillator: {h: 0, R: 1, omega: 2, base: 1}\n", "oscillator.base (did you mean a?)"),
    ],
)  # fmt: skip
def test_a_force_that_cannot_be_is_refused(text, part):
    assert part in refusal(text)


def test_the_schema_asks_for_a_force_or_a_base():
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    given = {"h": 0.1, "R": 0.8, "omega": 2.0}
    for force in ({"f": 1.0}, {"f": 0.0, "a": 0.0}, {"a": 0.1}, {"a": [0.0, 0.1]}):
        assert validator.is_valid({"oscillator": {**given, **force}})
    for force in ({}, {"a": -1.0}, {"a": 0}, {"a": 0.0}):
        assert not validator.is_valid({"oscillator": {**given, **force}})
