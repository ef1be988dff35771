"""The configuration: reading and writing it, overrides, its JSON schema, and a shaken base."""

import json
import random
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import xarray as xr
import yaml

from sweeps.config.groups import STARTS, OscillatorConfig
from sweeps.config.loading import load_config, parse_config
from sweeps.config.sweep import json_schema
from sweeps.errors import ConfigError
from tests.helpers.configurations import EXAMPLE, load, oscillator_yaml, refusal
from tests.helpers.odd_inputs import BASES, TABLES, document
from tests.helpers.places import CONFIGS
from tests.helpers.rigs import rig
from vibroimpact.oscillator import PARAMETERS


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


@pytest.mark.parametrize("null", ["null", "~"])
def test_an_output_that_is_null_is_left_out(null):
    assert load(f"name: a\noutput: {null}\n{oscillator_yaml()}").output == Path("a.h5")


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
        ({"oscillator": {(1, 2): 3}}, [], "unknown key oscillator.(1, 2); expected: a mapping"),
        ({"oscillator": CYCLIC}, [], "the configuration: more than 16 levels are not allowed"),
        (None, [], "the configuration is None; expected: a YAML file, or a mapping with keys"),
        (["oscillator"], [], "the configuration is ['oscillator']; expected: a YAML file, or"),
        (xr.Dataset({"status": 0}), [], "; vibroimpact info --config shows that of a sweep file"),
        ("a.h5", [], "YAML file in UTF-8; vibroimpact info --config shows that of a sweep file"),
        ({}, [1], "override 1: expected key=value, for example oscillator.h=0.2"),
        ({}, "name=a", "overrides = 'name=a'; expected: a list of texts key=value"),
        ({}, None, "overrides = None; expected: a list of texts key=value"),
    ],
)
def test_arguments_that_are_no_configuration(source, overrides, part):
    Path("a.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ConfigError) as caught:
        load_config(source, overrides)
    assert part in str(caught.value)


def test_the_defaults_are_the_documented_ones():
    config, example = load(oscillator_yaml()), load(EXAMPLE)
    assert (config.name, config.output) == ("sweep", Path("sweep.h5"))
    assert (example.name, str(example.output)) == ("frequency-bifurcation", "results/frequency.h5")
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
    lengths = (len(values) for values in config.sweep.grid.axes.values())
    assert config.sweep.grid.shape == tuple(lengths)


def test_configurations_are_equal_whatever_was_computed_of_them():
    one, other = load(EXAMPLE), load(EXAMPLE)
    assert one.size == 4096 and one == other == load(EXAMPLE, "record.phase=0")
    assert one != load(EXAMPLE, "record.periods=99")
    start = "start: {v0: [1, 2], x0: [-1, -2]}\n"
    # Another order of the axes.
    assert load(oscillator_yaml() + start) != load(start + oscillator_yaml())
    with pytest.raises(ValueError, match="frozen"):
        one.record.periods = 3


@pytest.mark.parametrize("text", ["1e-3", "'1e-3'", "1E-3", "+.001", "0.001"])
def test_numbers_are_read_however_they_are_written(text):
    assert load(oscillator_yaml(h=text)).oscillator.h == 1e-3


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
    record = {"transient": 1000, "periods": 100, "phase": 0.0, "impacts": 64}
    assert plain["record"] == record | {"trajectory": False, "diagnostics": ["period"]}


@pytest.fixture(scope="module")
def validator():
    """Return what an editor asks about a document."""
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert {"$schema", "$id"} < {*schema}
    return jsonschema.Draft202012Validator(schema)


def test_the_schema_accepts_the_example_and_refuses_a_wrong_one(validator):
    texts = [EXAMPLE, *(path.read_text() for path in CONFIGS.glob("**/*.yaml"))]
    for text in texts:
        validator.validate(yaml.safe_load(text))
    wrong = ["hh: 1", "record: {periods: 0}", "record: {diagnostics: [speed]}"]
    for text in (*wrong, "method: {integrator: euclid}", "method: {steps_per_period: 3}"):
        assert not validator.is_valid(yaml.safe_load(oscillator_yaml() + text))
    of_rigs = rig(mass=None), rig(gap=None), rig(q=1), rig(mass="[1, 2]"), rig(damping="-1")
    for text in ("oscillator: {h: 1}\n", *of_rigs):
        assert not validator.is_valid(yaml.safe_load(text)), text


EDGES = (-1.0, -5e-324, 0.0, 5e-324, 0.5, 1.0, 1.0000000000000002, 1.2, 1e300)


@pytest.mark.parametrize("form", ["{v}", "[0.25, {v}]", "{{start: 0.5, stop: {v}, num: 2}}",
                                  "{{start: {v}, stop: 0.5, num: 2}}"])  # fmt: skip
@pytest.mark.parametrize("name", [*OscillatorConfig.model_fields, *STARTS])
def test_the_schema_has_the_bounds_of_every_parameter(validator, name, form):
    """An editor marks a number exactly where the parameter does not allow it."""
    for value in EDGES:
        given = form.format(v=f"{value:.17e}")
        text = oscillator_yaml(**{name: given} if name in OscillatorConfig.model_fields else {})
        text += f"start: {{{name}: {given}}}" if name in STARTS else ""
        assert validator.is_valid(yaml.safe_load(text)) == PARAMETERS[name].accepts(value), text


def test_the_schema_describes_every_parameter():
    definitions = json_schema()["$defs"]
    groups = "OscillatorConfig", "StartConfig"
    properties = {k: v for group in groups for k, v in definitions[group]["properties"].items()}
    for name, parameter in PARAMETERS.items():
        description = properties[name]["description"]
        assert parameter.meaning in description
        assert (f"[{parameter.unit}]" in description) == (parameter.unit != "1")
        assert parameter.allowed in description


DOCUMENTS = [*map(yaml.safe_load, BASES), *TABLES]


def is_loaded(document):
    """Whether the loader accepts a document."""
    try:
        parse_config(json.dumps(document), "sweep.yaml", "sweep")
    except ConfigError:
        return False
    return True


MANY = [pytest.param(seed, 2000, marks=pytest.mark.campaign) for seed in range(2, 12)]


@pytest.mark.parametrize(("seed", "count"), [(1, 200), *MANY])
def test_the_schema_accepts_what_the_loader_accepts(validator, seed, count):
    rng, marked, refused = random.Random(seed), 0, 0
    for _ in range(count):
        tree = document(rng, DOCUMENTS)
        errors, loaded = [*validator.iter_errors(tree)], is_loaded(tree)
        assert not (loaded and errors), (tree, [error.message for error in errors])
        refused += not loaded
        marked += bool(errors)
    assert 0.5 * count < refused < 0.9 * count and marked > 0.5 * refused


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("oscillator.omga=1", ["oscillator.omga", "did you mean omega?", "clearance"]),
        ("oscillator.h.num=2", ["oscillator.h = 0.1 has no keys"]),
        ("oscillator.h=[1,", ["not valid YAML"]),
        ("oscillator.h", ["expected key=value"]),
        ("oscillator.h=-0,1", ["oscillator.h = -0,1 has a decimal comma", "point, no comma"]),
        ("oscillator={h: 0,1, R: 1}", ["unknown key oscillator.1 (", "decimal point, no comma"]),
        ("record.trajectory={ever: 2}", ["record.trajectory.ever (did you mean every?)"]),
        ("oscillator={h: 1, h: 2}", ["h: 2}: oscillator.h is given twice, first in override"]),
        ("oscillator={? {a: 1, a: 2} : 1}", ["a list or mapping is not allowed as a key"]),
        ("record.trajectory=yes", ["record.trajectory = yes is not allowed"]),
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
        ("oscillator: {h: 0, R: 1, omega: 2, a: -0.0e+3}\n", "oscillator.f is missing; expected: "),
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
