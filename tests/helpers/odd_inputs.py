"""Odd configurations: valid ones with random changes, and texts with random damage."""

import copy

from tests.helpers.places import CONFIGS

FULL = """\
name: all
oscillator:
  h: 0.1
  R: [0.5, 0.8]
  omega: {start: 0.8, stop: 4.0, num: 16, spacing: log}
  f: 1.0
  p: 1.0
  clearance: 0.1
start: {x0: 0.0, v0: [0.0, 1.0]}
method: {integrator: exact, impact: exact, steps_per_period: 64}
record: {transient: 5, periods: 5, phase: 1.0, impacts: 6, trajectory: {every: 4}}
compression: gzip
output: x.h5
"""
FOLLOWED = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 2.5, stop: 2.7, num: 5}, f: 1.0}
record: {transient: 20, periods: 10, impacts: 8, diagnostics: [period, lyapunov]}
follow: {axis: omega, direction: down}
output: x.h5
"""
SCENES = [path.read_text() for path in sorted(CONFIGS.glob("*.yaml"))]
# Without the scene of a table, whose file would be missing.
BASES = [FULL, FOLLOWED, *(text for text in SCENES if "points:" not in text)]

#: Tables beside an oscillator and a rig.
TABLES = [
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


def document(rng, bases):
    """Return one of some documents: two of three have groups or values of another, or odd ones."""
    tree, other = (copy.deepcopy(rng.choice(bases)) for _ in range(2))
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


def damaged(rng, text):
    """Return a text with some characters or lines changed, removed or doubled."""
    for _ in range(rng.randint(1, 4)):
        begin = rng.randrange(len(text) + 1)
        signs = ["", "", *":\n\t {]#&!'\"\0\x85\x9b\ud800\U0001f600"]
        text = text[:begin] + rng.choice(signs) + text[begin + rng.choice([0, 1, 1, 5, 40]) :]
        if rng.random() < 0.3:
            lines = text.splitlines(keepends=True) or [""]
            lines.insert(rng.randrange(len(lines) + 1), rng.choice(lines))
            text = "".join(lines)
    return text
