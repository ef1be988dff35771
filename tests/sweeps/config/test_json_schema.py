"""The JSON schema accepts all random documents that the loader accepts, and marks most others."""

import copy
import json

import numpy as np
import pytest

from sweeps.config.loading import parse_config
from sweeps.config.sweep import json_schema
from sweeps.errors import ConfigError

KEYS = ("h", "R", "omega", "f", "p", "clearance", "a")
RIG = ("mass", "stiffness", "damping", "frequency", "gap", "R", "force", "base")
MODEL_NAME = {
    "stiffness": "p", "damping": "h", "force": "f", "frequency": "omega", "gap": "clearance",
    "base": "a",
}  # fmt: skip
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


class Documents:
    """Random documents, most of them with one to three changes of a valid one."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def pick(self, values):
        return values[self.rng.integers(len(values))]

    def chance(self, share):
        return self.rng.random() < share

    def value(self, name, *, axis=True):
        """Return a number, a list or a range that is valid for most names."""
        number = round(float(self.rng.uniform(0.1, 0.9)), 2)
        form = self.pick(("number", "number", "list", "range")) if axis else "number"
        if form == "list":
            return [number, round(number / 2, 3)][: self.pick((1, 2, 2))]
        if form == "range":
            extent = {"start": number / 2, "stop": number, "num": self.pick((2, 3, 7))}
            if self.chance(0.1):
                extent["step"] = extent.pop("num") * number / 40
            return {
                **extent,
                **({"spacing": self.pick(("linear", "log"))} if self.chance(0.5) else {}),
            }
        return number

    def group(self, names, *, axis=True):
        given = {name: self.value(name, axis=axis) for name in names if name != "mass"}
        optional = ("p", "clearance", "a", "base", *(("f",) if "a" in given else ()))
        for name in optional:
            if self.chance(0.5):
                given.pop(name, None)
        return {"mass": 0.5, **given} if "mass" in names else given

    def valid(self):
        """Return a document that is valid in most cases."""
        of_rig, table = self.chance(0.3), self.chance(0.25)
        names = RIG if of_rig else KEYS
        group = self.group(names, axis=not table)
        document = {}
        if table:
            columns = [name for name in names if self.chance(0.4)] or ["R"]
            named = {name: self.pick((name, MODEL_NAME.get(name, name))) for name in columns}
            document["points"] = {named[name]: [0.5, self.pick((0.25, 0.5, 0))] for name in columns}
            if self.chance(0.3):
                document["points"][self.pick(("note", "n-1", "x0", "status", "label"))] = [1, "a"]
            group = {name: value for name, value in group.items() if name not in columns}
        document["rig" if of_rig else "oscillator"] = group
        self.add_settings(document, names, of_rig)
        return document

    def add_settings(self, document, names, of_rig):
        if self.chance(0.4):
            document["start"] = {
                name: value
                for name, value in (
                    ("x0", -0.5),
                    ("v0", [0, 0.5]),
                    ("phase", self.pick((0, 6, 6.5, [0, 1], [7]))),
                )
                if self.chance(0.5)
            }
        if self.chance(0.6):
            record = {
                "transient": self.pick(("auto", 100, 0, "AUTO")),
                "longest": self.pick((None, None, None, 500)),
                "periods": 50, "phase": 1.5, "impacts": 0,
                "trajectory": self.pick((False, {"every": 2})),
                "diagnostics": self.pick((["period"], ["period"], ["period", "lyapunov"], [])),
            }  # fmt: skip
            document["record"] = {key: value for key, value in record.items() if self.chance(0.5)}
        if self.chance(0.5):
            method = {
                "integrator": self.pick(("exact", "exact", "rk4", "newmark")),
                "impact": self.pick(("exact", "plain", "cubic")),
                "steps_per_period": self.pick((None, 1000, 1e3)),
                "allow_unstable": self.pick((True, False)),
            }
            document["method"] = {key: value for key, value in method.items() if self.chance(0.6)}
        if self.chance(0.3):
            axis = self.pick((*names, "omega", "x0"))
            document["follow"] = self.pick(
                (None, {"axis": axis, "direction": "both"}, {"axis": axis})
            )
        if self.chance(0.3):
            units = {
                "length": self.pick(("m", "mm")),
                "time": self.pick(("s", "s", "seconds")),
                "mass": self.pick(("kg", "g")),
            }
            document["units"] = {key: value for key, value in units.items() if self.chance(0.5)}
        if self.chance(0.3):
            document |= {"name": self.pick(("a", 2024, True, "Versuch é")), "output": "a.h5"}
        if self.chance(0.2):
            document |= {
                "compression": self.pick(("gzip", "none", None)),
                "points": document.get("points"),
            }
        if self.chance(0.1):
            document.setdefault("rig" if not of_rig else "oscillator", self.pick((None, {})))

    def changed(self, document):
        """Return a document with a value replaced, removed or added at a random place."""
        place = document
        while True:
            key = self.pick([*place] or ["h"])
            inner = place.get(key)
            if not (isinstance(inner, dict) and self.chance(0.8)):
                break
            place = inner
        how = self.pick(("replace", "replace", "remove", "add"))
        if how == "remove":
            place.pop(key, None)
        elif how == "replace":
            place[key] = copy.deepcopy(self.pick(ODD))
        else:
            others = ("x0", "phase", "refine", "accuracy", "name", "record", "start")
            place[self.pick((*KEYS, *RIG, *others))] = copy.deepcopy(self.pick(ODD))
        return document

    def any(self):
        document = self.valid()
        for _ in range(self.pick((0, 0, 0, 1, 1, 2))):
            document = self.changed(document)
        return document


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
    documents, marked, refused = Documents(seed), 0, 0
    for _ in range(count):
        document = documents.any()
        errors, loaded = [*validator.iter_errors(document)], is_loaded(document)
        assert not (loaded and errors), (document, [error.message for error in errors])
        refused += not loaded
        marked += bool(errors)
    assert 0.5 * count < refused < 0.9 * count and marked > 0.5 * refused


def test_the_schema_accepts_what_the_loader_accepts():
    compare(seed=1, count=400)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(2, 12))
def test_the_schema_accepts_what_the_loader_accepts_of_thousands(seed):
    compare(seed, 2000)
