"""The JSON schema accepts all random documents that the loader accepts, and marks most others."""

import json
import random

import pytest
import yaml

from sweeps.config.loading import parse_config
from sweeps.config.sweep import json_schema
from sweeps.errors import ConfigError
from tests.helpers.odd_inputs import BASES, TABLES, document

DOCUMENTS = [*map(yaml.safe_load, BASES), *TABLES]


def is_loaded(document):
    """Whether the loader accepts a document."""
    try:
        parse_config(json.dumps(document), "sweep.yaml", "sweep")
    except ConfigError:
        return False
    return True


MANY = [pytest.param(seed, 2000, marks=pytest.mark.campaign) for seed in range(2, 12)]


@pytest.mark.parametrize(("seed", "count"), [(1, 400), *MANY])
def test_the_schema_accepts_what_the_loader_accepts(seed, count):
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    rng, marked, refused = random.Random(seed), 0, 0
    for _ in range(count):
        tree = document(rng, DOCUMENTS)
        errors, loaded = [*validator.iter_errors(tree)], is_loaded(tree)
        assert not (loaded and errors), (tree, [error.message for error in errors])
        refused += not loaded
        marked += bool(errors)
    assert 0.5 * count < refused < 0.9 * count and marked > 0.5 * refused
