"""The configuration: what is read, and what is refused in which words."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from sweeps import config as config_module
from sweeps.config import OscillatorSection, StartSection, json_schema
from sweeps.loading import ConfigError, load_config
from vibroimpact.impacts import IMPACT_RULES
from vibroimpact.integrators import INTEGRATORS
from vibroimpact.oscillator import PARAMETERS

EXAMPLE = """\
name: frequency-bifurcation
oscillator: {h: 0.1, R: 0.8, omega: {start: 0.8, stop: 4.0, num: 4096}, f: 1.0}
start: {x0: 0.0, v0: 0.0}
method: {integrator: newmark, impact: reduced-step, steps_per_period: 100}
record: {transient: 200, periods: 100, phase: 0.0, impacts: 64, trajectory: false}
output: results/frequency.h5
"""
OSCILLATOR = {"h": "0.1", "R": "0.8", "omega": "2.0", "f": "1.0"}


@pytest.fixture
def load(tmp_path):
    """Load a text as a configuration file."""

    def _load(text, overrides=()):
        path = tmp_path / "sweep.yaml"
        path.write_text(text, encoding="utf-8")
        return load_config(path, overrides)

    return _load


@pytest.fixture
def refusal(load):
    """Return the message with which a text is refused."""

    def _refusal(text, overrides=()):
        with pytest.raises(ConfigError) as caught:
            load(text, overrides)
        message = str(caught.value)
        for jargon in ("Input should", "type=", "input_value", "errors.pydantic.dev", "<mapping>"):
            assert jargon not in message
        return message

    return _refusal


def oscillator(**values):
    """Return a configuration of one line with these values among valid ones."""
    items = ", ".join(f"{name}: {value}" for name, value in (OSCILLATOR | values).items())
    return f"oscillator: {{{items}}}\n"


# What is read


def test_the_example_is_read_as_written(load):
    config = load(EXAMPLE)
    assert (config.name, config.output) == ("frequency-bifurcation", Path("results/frequency.h5"))
    assert (config.method.integrator, config.method.impact) == ("newmark", "reduced-step")
    assert config.record.trajectory is False
    assert list(config.grid.axes) == ["omega"]
    np.testing.assert_array_equal(config.grid.axes["omega"], np.linspace(0.8, 4.0, 4096))
    assert config.grid.fixed == {
        "h": 0.1, "R": 0.8, "f": 1.0, "p": 1.0, "clearance": 0.0, "x0": 0.0, "v0": 0.0,
    }  # fmt: skip


def test_the_defaults_are_the_documented_ones(load):
    config, example = load(oscillator()), load(EXAMPLE)
    assert (config.name, config.output) == ("sweep", Path("sweep.h5"))
    for section in ("start", "method", "record"):
        given = getattr(example, section)
        assert getattr(config, section).model_dump() == given.model_dump()
    assert config.grid.axes == {}
    for name, parameter in PARAMETERS.items():
        if parameter.default is not None:
            assert config.grid.fixed[name] == parameter.default


def test_the_output_is_named_after_the_sweep(load):
    assert load("name: other\n" + oscillator()).output == Path("other.h5")


def test_the_sections_have_every_parameter():
    names = [*OscillatorSection.model_fields, *StartSection.model_fields]
    assert names == list(PARAMETERS)


@pytest.mark.parametrize(
    ("text", "axes"),
    [
        ("start: {v0: [1, 2], x0: [-1]}\noscillator: {f: 1, R: [1], h: 0, omega: [1, 2]}\n",
         ["v0", "x0", "R", "omega"]),
        ("oscillator: {omega: [1], f: 1, R: [1], h: 0}\nstart: {x0: [-1], v0: 0}\n",
         ["omega", "R", "x0"]),
    ],
)  # fmt: skip
def test_the_axes_are_in_the_order_of_the_file(load, text, axes):
    config = load(text)
    assert list(config.grid.axes) == axes
    assert config.grid.shape == tuple(len(values) for values in config.grid.axes.values())


def test_one_value_in_a_list_or_range_is_an_axis(load):
    axes = load(oscillator(h="[0.3]", f="{start: 2, stop: 2, num: 1}")).grid.axes
    assert {name: list(values) for name, values in axes.items()} == {"h": [0.3], "f": [2.0]}


def test_log_spacing(load):
    values = load(oscillator(h="{start: 1e-4, stop: 1, num: 5, spacing: log}")).grid.axes["h"]
    np.testing.assert_allclose(values, [1e-4, 1e-3, 1e-2, 1e-1, 1.0], rtol=1e-14)
    assert (values[0], values[-1]) == (1e-4, 1.0)


@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_no_value_of_a_range_is_rounded_out_of_it(load, spacing):
    low = math.nextafter(1.0, 0.0)
    text = f"{{start: {low!r}, stop: 1, num: 50, spacing: {spacing}}}"
    values = load(oscillator(R=text)).grid.axes["R"]
    assert values.max() == 1.0 and values.min() == low


@pytest.mark.parametrize("text", ["1e-3", "'1e-3'", "1E-3", "+.001", "0.001"])
def test_numbers_are_read_however_they_are_written(load, text):
    assert load(oscillator(h=text)).oscillator.h == 1e-3


def test_integers_may_be_written_as_floats(load):
    config = load(oscillator() + "record: {transient: 1e3, periods: 20.0}\n")
    assert (config.record.transient, config.record.periods) == (1000, 20)


def test_a_trajectory_is_asked_for_by_every(load):
    config = load(oscillator() + "record: {trajectory: {every: 5}}\n")
    assert config.record.trajectory and config.record.trajectory.every == 5


def test_the_configuration_is_frozen(load):
    config = load(EXAMPLE)
    with pytest.raises(ValueError):
        config.method.integrator = "rk4"


def test_every_integrator_and_impact_rule_is_accepted(load):
    for integrator in INTEGRATORS:
        for impact in IMPACT_RULES:
            method = f"method: {{integrator: {integrator}, impact: {impact}}}\n"
            assert load(oscillator() + method).method.impact == impact


# --set


def test_overrides_replace_and_add_in_order(load):
    overrides = [
        "oscillator.h=0.2",
        "oscillator.omega.num=7",
        "start.v0=[1, 2]",
        "record.trajectory={every: 2}",
        "name=renamed",
    ]
    config = load(EXAMPLE, overrides)
    assert config.oscillator.h == 0.2
    assert config.grid.shape == (7, 2)
    assert config.record.trajectory and config.record.trajectory.every == 2
    assert config.name == "renamed"


def test_overrides_may_add_a_section(load):
    assert load(oscillator(), ["method.integrator=rk4"]).method.integrator == "rk4"


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
        ("record.trajectory={ever: 2}", ["record.trajectory.every is missing"]),
        ("=", ["unknown key"]),
        ("a..b=1", ["unknown key a"]),
        ("<scalar>=1", ["unknown key <scalar>"]),
    ],
)
def test_a_wrong_override_is_reported_as_one(refusal, override, parts):
    message = refusal(EXAMPLE.replace("false", "{every: 1}"), [override])
    for line in message.splitlines():
        assert line.startswith(f"--set {override}")
    for part in parts:
        assert part in message


# to_yaml


@pytest.mark.parametrize(
    "text",
    [
        EXAMPLE,
        oscillator(),
        "start: {v0: [1, 2]}\nrecord: {trajectory: {every: 3}}\n"
        "oscillator: {f: 1, R: 1, h: {start: 1e-7, stop: 1, num: 9, spacing: log}, omega: .1}\n"
        "name: 'on'\n",
        f"name: '1.0'\n{oscillator(h='0.30000000000000004', f='[1e22, 3]')}",
    ],
)
def test_to_yaml_round_trip(load, text):
    config = load(text)
    written = config.to_yaml()
    again = load(written)
    assert again.to_yaml() == written
    assert list(again.grid.axes) == list(config.grid.axes)
    for name, values in config.grid.axes.items():
        np.testing.assert_array_equal(again.grid.axes[name], values)
    assert again.grid.fixed == config.grid.fixed
    assert again.model_dump(exclude={"output"}) == config.model_dump(exclude={"output"})


def test_to_yaml_is_complete_and_keeps_the_order(load):
    plain = yaml.safe_load(load("start: {v0: 1}\n" + oscillator()).to_yaml())
    assert list(plain) == ["name", "start", "oscillator", "method", "record"]
    assert list(plain["start"]) == ["v0", "x0"]
    assert plain["record"] == {
        "transient": 200, "periods": 100, "phase": 0.0, "impacts": 64, "trajectory": False,
    }  # fmt: skip


# What is refused: every message has the file, the line, the key, the given and the allowed


@pytest.mark.parametrize(
    ("values", "key", "given", "allowed"),
    [
        ({"R": "1.2"}, "oscillator.R", "1.2", "a number from 0 to 1"),
        ({"omega": "0"}, "oscillator.omega", "0", "> 0"),
        ({"h": "-1"}, "oscillator.h", "-1", ">= 0"),
        ({"h": ".nan"}, "oscillator.h", ".nan", ">= 0"),
        ({"h": "nan"}, "oscillator.h", "nan", "finite number >= 0"),
        ({"f": ".inf"}, "oscillator.f", ".inf", "finite number >= 0"),
        ({"f": "1e999"}, "oscillator.f", "1e999", "finite number >= 0"),
        ({"f": "yes"}, "oscillator.f", "yes", "finite number >= 0"),
        ({"f": "true"}, "oscillator.f", "true", "finite number >= 0"),
        ({"f": ""}, "oscillator.f", "(nothing)", "finite number >= 0"),
        ({"f": "0x10"}, "oscillator.f", "0x10", "finite number >= 0"),
        ({"h": "[]"}, "oscillator.h", "[]", "a list of such numbers"),
        ({"h": "[1, abc]"}, "oscillator.h[1]", "abc", ">= 0"),
        ({"h": "[1, -2]"}, "oscillator.h", "contains -2,", ">= 0"),
        ({"R": "{start: 0, stop: 1.2, num: 3}"}, "oscillator.R", "contains 1.2,", "from 0 to 1"),
        ({"f": "{start: 0, stop: 1, num: 0}"}, "oscillator.f.num", "0", "an integer from 1"),
        ({"f": "{start: 0, stop: 1, num: 1.5}"}, "oscillator.f.num", "1.5", "an integer from 1"),
        ({"f": "{start: 0, stop: 1, num: 1e8}"}, "oscillator.f.num", "100000000", "from 1"),
        ({"f": "{start: x, stop: 1, num: 2}"}, "oscillator.f.start", "x", "finite number"),
        ({"f": "{start: 0, stop: 1, num: 1}"}, "oscillator.f", "num: 1", "to be equal"),
        ({"f": "{start: 0, stop: 1, num: 2, spacing: log}"}, "oscillator.f", "log", "start > 0"),
        ({"f": "{start: 0, stop: 1, num: 2, spacing: cubic}"}, "oscillator.f.spacing", "cubic",
         "linear or log"),
    ],
)  # fmt: skip
def test_refused_values(refusal, values, key, given, allowed):
    message = refusal("# a comment\n" + oscillator(**values))
    assert message.count("\n") == 0
    assert "sweep.yaml, line 2: " in message
    assert f"{key} = " in message and given in message and allowed in message


@pytest.mark.parametrize(
    ("line", "key", "given", "allowed"),
    [
        ("method: {integrator: newmrak}", "method.integrator", "newmrak",
         "is unknown (did you mean newmark?); expected: integrator between impacts: "
         + ", ".join(INTEGRATORS)),
        ("method: {impact: reduced}", "method.impact", "reduced", ", ".join(IMPACT_RULES)),
        ("method: {impact: [plain]}", "method.impact", "[plain]", ", ".join(IMPACT_RULES)),
        ("method: {steps_per_period: 3}", "method.steps_per_period", "3", "from 4 to 1000000"),
        ("record: {periods: 0}", "record.periods", "0", "an integer from 1"),
        ("record: {transient: -1}", "record.transient", "-1", "an integer from 0"),
        ("record: {impacts: false}", "record.impacts", "false", "an integer from 0"),
        ("record: {phase: 6.2832}", "record.phase", "6.2832", "< 2 pi"),
        ("record: {phase: -0.1}", "record.phase", "-0.1", ">= 0"),
        ("record: {trajectory: true}", "record.trajectory", "true", "false, or {every: k}"),
        ("record: {trajectory: [1]}", "record.trajectory", "[1]", "false, or {every: k}"),
        ("record: {trajectory: {every: 0}}", "record.trajectory.every", "0", "an integer from 1"),
        ("record: 3", "record", "3", "a mapping with keys among transient, periods"),
        ("method:", "method", "(nothing)", "a mapping with keys among integrator"),
        ("name: a/b", "name", "a/b", "without slashes"),
        ("name: ''", "name", "(nothing)", "without slashes"),
        ("name: [a]", "name", "[a]", "a text"),
        ("output: {a: b}", "output", "{a: b}", "a path"),
    ],
)  # fmt: skip
def test_refused_settings(refusal, line, key, given, allowed):
    message = refusal(oscillator() + line + "\n")
    assert message.count("\n") == 0
    assert "sweep.yaml, line 2: " in message
    assert f"{key} = {given}" in message and allowed in message


def test_unknown_key(refusal):
    message = refusal("oscillator:\n  h: 0.1\n  R: 1\n  omga: 1\n  omega: 1\n  f: 1\n")
    assert "line 4: unknown key oscillator.omga (did you mean omega?)" in message
    assert "keys among h, R, omega, f, p, clearance" in message


def test_unknown_key_in_another_case(refusal):
    assert "(did you mean R?)" in refusal(oscillator(r="1"))


def test_missing_key_names_the_line_of_its_section(refusal):
    message = refusal("name: a\noscillator:\n  h: 0.1\n  R: 1\n  omega: 1\n")
    assert "line 2: oscillator.f is missing; expected: forcing amplitude" in message


def test_missing_section(refusal):
    assert "line 1: oscillator is missing" in refusal("name: a\n")


@pytest.mark.parametrize(
    ("x0", "clearance"),
    [("0.5", "0.2"), ("[-1, 0.5]", "1"), ("0.5", "[1, 0.2]"),
     ("{start: 0, stop: 0.5, num: 2}", "{start: 0.2, stop: 3, num: 4}")],
)  # fmt: skip
def test_start_beyond_the_stop(refusal, load, x0, clearance):
    text = oscillator(clearance=clearance) + f"start: {{x0: {x0}}}\n"
    if clearance == "1":
        assert load(text).grid.size == 2
        return
    message = refusal(text)
    assert "line 2: start.x0: x0 = 0.5 lies beyond the stop at clearance = 0.2" in message
    assert "every x0 must be <= every clearance" in message


def test_default_start_beyond_the_stop(refusal):
    message = refusal("name: a\n" + oscillator(clearance="-0.1"))
    assert "line 2: oscillator.clearance: x0 = 0 lies beyond the stop" in message


def test_all_errors_are_reported(refusal):
    message = refusal(oscillator(R="2", h="-1") + "recrod: {}\n")
    assert len(message.splitlines()) == 3
    assert all("sweep.yaml, line" in line for line in message.splitlines())


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("a: [1, 2\nb: 3\n", ["line 2, column 2", "not valid YAML"]),
        ("a:\n\t- b\n", ["line 2, column 1", "not valid YAML"]),
        ("a: 1\n---\nb: 2\n", ["line 2, column 1", "not valid YAML"]),
        ("a: !!python/object:os.system x\n", ["line 1, column 4", "tags are not allowed"]),
        ("a: &x [1]\nb: *x\n", ["line 2, column 4", "aliases"]),
        ("a: &x [*x]\n", ["line 1", "aliases"]),
        ("? [a, b]\n: 1\n", ["line 1", "not allowed as a key"]),
        ("a: \x00\n", ["not valid YAML"]),
        ("[" * 5000, ["not valid YAML"]),
        ("", ["is empty", "expected: a mapping with keys among name, oscillator"]),
        ("# only a comment\n", ["is empty"]),
        ("- h\n- R\n", ["[h, R]", "expected: a mapping"]),
        ("just text", ["just text", "expected: a mapping"]),
    ],
)  # fmt: skip
def test_what_is_not_a_mapping_in_yaml(refusal, text, parts):
    message = refusal(text)
    assert "sweep.yaml" in message
    for part in parts:
        assert part in message


def test_duplicate_key(refusal):
    message = refusal("oscillator:\n  h: 0.1\n  R: 1\n  h: 0.2\n")
    assert "line 4: oscillator.h is given twice" in message and "line 2" in message


@pytest.mark.parametrize("name", ["missing.yaml", "folder", "binary.yaml", "a\0b"])
def test_a_file_that_cannot_be_read(tmp_path, name):
    (tmp_path / "folder").mkdir()
    (tmp_path / "binary.yaml").write_bytes(b"h: \xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"cannot be read .*expected: a YAML file"):
        load_config(tmp_path / name)


# The JSON schema


def test_the_schema_accepts_the_example_and_refuses_a_wrong_one():
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    root = Path(config_module.__file__).parents[1]
    texts = [EXAMPLE, *(path.read_text() for path in root.glob("configs/**/*.yaml"))]
    for text in texts:
        validator.validate(yaml.safe_load(text))
    for wrong in ("record: {periods: 0}\n", "method: {integrator: euclid}\n", "hh: 1\n"):
        assert not validator.is_valid(yaml.safe_load(oscillator() + wrong))
    assert not validator.is_valid(yaml.safe_load("oscillator: {h: 1}\n"))


def test_the_schema_describes_every_parameter():
    definitions = json_schema()["$defs"]
    properties = {
        **definitions["OscillatorSection"]["properties"],
        **definitions["StartSection"]["properties"],
    }
    for name, parameter in PARAMETERS.items():
        description = properties[name]["description"]
        assert parameter.meaning in description
        assert f"[{parameter.unit}]" in description
        assert parameter.allowed in description
