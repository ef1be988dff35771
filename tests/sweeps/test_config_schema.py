"""The JSON schema of a configuration."""

from pathlib import Path

import pytest
import yaml

from sweep_files import EXAMPLE, oscillator
from sweeps import load_config
from sweeps.config import sweep as config_module
from sweeps.config.groups import OscillatorConfig, StartConfig
from sweeps.config.json_schema import json_schema
from vibroimpact.oscillator import PARAMETERS

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
    for wrong in (
        "record: {periods: 0}\n",
        "record: {diagnostics: [speed]}\n",
        "method: {integrator: euclid}\n",
        "method: {steps_per_period: 3}\n",
        "hh: 1\n",
    ):
        assert not validator.is_valid(yaml.safe_load(oscillator() + wrong))
    assert not validator.is_valid(yaml.safe_load("oscillator: {h: 1}\n"))


EDGES = (-1.0, -5e-324, 0.0, 5e-324, 0.5, 1.0, 1.0000000000000002, 1.2, 1e300)


@pytest.mark.parametrize("form", ["{v}", "[0.5, {v}]", "{{start: 0.5, stop: {v}, num: 2}}",
                                  "{{start: {v}, stop: 0.5, num: 2}}"])  # fmt: skip
@pytest.mark.parametrize("name", [*OscillatorConfig.model_fields, *StartConfig.model_fields])
def test_the_schema_has_the_bounds_of_every_parameter(name, form):
    """An editor marks a number exactly where the parameter does not allow it."""
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    assert {"$schema", "$id"} < {*schema}
    validator = jsonschema.Draft202012Validator(schema)
    for value in EDGES:
        given = form.format(v=f"{value:.17e}")
        text = oscillator(**{name: given} if name in OscillatorConfig.model_fields else {})
        text += f"start: {{{name}: {given}}}" if name in StartConfig.model_fields else ""
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


def test_a_sweep_with_another_record_is_computed_by_that_record():
    config = load_config({"oscillator": {"h": 0.1, "R": 0.8, "omega": 2.0, "f": [1.0, 1.5]}})
    assert config.spec.periods == 100  # also cached
    other = config.with_record(periods=7)
    assert other.grid.shape == config.grid.shape == (2,)
    assert other.spec.scaled and config.spec.scaled
    assert other.spec.periods == 7
    assert config.spec.periods == 100
