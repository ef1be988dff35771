"""The JSON schema accepts all random documents that the loader accepts, and marks most others."""

import copy
import json
import random

import pytest
import yaml

from sweeps.config.loading import parse_config
from sweeps.config.sweep import json_schema
from sweeps.errors import ConfigError
from tests.helpers.odd_inputs import BASES as TEXTS

#: The scenes, and tables beside an oscillator and a rig, of which the documents take their groups.
BASES = [yaml.safe_load(text) for text in TEXTS] + [
    {"points": {"omega": [0.5, 0.25], "a": [0, 1], "note": ["a", "b"]},
     "oscillator": {"h": 0.1, "R": 0.8}, "units": {"length": "mm", "time": "s"}},
    {"points": {"frequency": [1, 2], "h": [0.5, 0.25], "x0": [-1, -2]},
     "rig": {"mass": 0.5, "stiffness": 100, "gap": 0.1, "R": 0.8, "base": 0.01}},
    {"points": {"mass": [1, 2]}, "method": {"integrator": "rk4", "allow_unstable": True},
     "rig": {"damping": 0.1, "stiffness": 9, "gap": [0, 1], "R": 0.8, "force": 1, "frequency": 2}},
]  # fmt: skip
#: Values that are wrong at most places, and right at some.
ODD = (
    None, True, False, -1, 0, 0.0, 1, 1.0, 1.5, 2, -0.5, 7, 1e-3, 1e9, 1e300, 10**400, 5e-324, "",
    "auto", "Auto", "yes", "abc", "m", "s", "exact", "a/b", "a\n", "Länge", [], {}, [0],
    [1], [1, 1.0], [0, 1], [None], [True], ["period"], [[1]], {"every": 1}, {"every": 0}, {"a": 1},
    {"start": 0, "stop": 1, "num": 3}, {"start": 0, "stop": 1, "num": 3, "spacing": "log"},
    {"start": 1, "stop": 2, "num": 2, "spacing": "log"}, {"start": 1, "stop": 1, "num": 1},
    {"start": 1, "stop": 2}, {"start": 1, "stop": 2, "num": 0}, {"start": 1, "stop": 2, "num": 1e8},
    {"start": 1, "stop": 2, "step": 0.5}, {"start": 1, "stop": 2, "step": 0},
    {"start": 1, "stop": 2, "step": 0.5, "num": 3}, {"start": 1, "stop": 2, "step": "x"},
    {"start": 1, "stop": 2, "step": 0.5, "spacing": "log"}, {"start": 1, "step": 0.5},
)  # fmt: skip


def document(rng):
    """Return a document: two of three have groups or values of another one, or odd ones."""
    tree, other = (copy.deepcopy(rng.choice(BASES)) for _ in range(2))
    for _ in range(rng.choice((0, 1, 2, 2, 3))):
        place, beside = tree, other
        while True:
            key = rng.choice([*place, *beside] or ["h"])
            inner = place.get(key)
            if not (isinstance(inner, dict) and rng.random() < 0.8):
                break
            place, beside = inner, beside.get(key)
            beside = beside if isinstance(beside, dict) else {}
        how = rng.choice(("replace", "other", "other", "remove", "add"))
        if how == "remove":
            place.pop(key, None)
        elif how == "other":
            place[key] = copy.deepcopy(beside.get(key, place.get(key)))
        else:
            added = rng.choice(("h", "gap", "base", "x0", "phase", "refine", "name", "start"))
            place[key if how == "replace" else added] = copy.deepcopy(rng.choice(ODD))
    return tree


def is_loaded(document):
    """Whether the loader accepts a document."""
    try:
        parse_config(json.dumps(document), "sweep.yaml", "sweep")
    except ConfigError:
        return False
    return True


def compare(seed, count):
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    rng, marked, refused = random.Random(seed), 0, 0
    for _ in range(count):
        tree = document(rng)
        errors, loaded = [*validator.iter_errors(tree)], is_loaded(tree)
        assert not (loaded and errors), (tree, [error.message for error in errors])
        refused += not loaded
        marked += bool(errors)
    assert 0.5 * count < refused < 0.9 * count and marked > 0.5 * refused


def test_the_schema_accepts_what_the_loader_accepts():
    compare(seed=1, count=400)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(2, 12))
def test_the_schema_accepts_what_the_loader_accepts_of_thousands(seed):
    compare(seed, 2000)
