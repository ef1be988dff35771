"""Odd input: valid configurations with random damage, and odd environments of a command."""

import yaml

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

ODD = r"""
1e308 -1e308 -0.0 0 5e-324 1e-300 1e999 nan .inf -.inf 1e9 1e18 99999999999999999999 true null ~ ''
[] {} [[]] [1,1,1] {start:0,stop:1,num:1e7} {start:1e-320,stop:1e308,num:3,spacing:log}
{start:-1e308,stop:1e308,num:2} &a *a !!python/object/apply:os.system !!binary "a\0b" 'a/b'
/etc/passwd ../../x 0x10 010 1:30 1_000 . 0.5 4 64 1e5 gzip rk4 plain euler x.png {a:{b:{c:{}}}}
"\U00110000" "\UFFFFFFFF" "\uD800" "\e[31m" "\x9b31m" "\u202Ex" "\0" "\r" "[/red]" $\frac{a ${x} %s
{} {start:1,stop:1,num:1} {start:0,stop:1,num:2} {num:3} [1e-9,1e9] [nan] [true] [''] [0,0.5] [2,1]
0.1 0.2 0.99 1 1.0 -1 2 3 7 1e-9 1e-3 1e3 verlet newmark cubic reduced-step exact up down both omega
x0 clearance period lyapunov [period] [lyapunov] [period,lyapunov] {every:1} {every:0} false on off
""".split()
NAMES = ["omga", "num", "x0", "", "a" * 99, "gap", "f", "R", "start", "<scalar>", "\x1b", "é", "1"]


def small(tree):
    """Reduce a configuration in place to a few points and periods, so that it can be run."""
    for group in ("oscillator", "start"):
        for value in tree.get(group, {}).values():
            if isinstance(value, dict) and "num" in value:
                value["num"] = "3"
    tree.setdefault("record", {}).update(transient="3", periods="4", impacts="3")
    tree["output"] = "x.h5"


def leaves(tree, path=()):
    """Yield the path of every value."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, (dict, list)):
            yield from leaves(value, (*path, key))


def mutated(rng):
    """Return the text of a valid configuration with one to three changes."""
    tree = yaml.load(rng.choice(BASES), Loader=yaml.BaseLoader)
    if rng.random() < 0.7:
        small(tree)
    gentle = rng.random() < 0.4  # numbers are replaced by numbers, mostly valid ones
    odd = []
    for _ in range(rng.choice([1, 1, 2, 3])):
        *path, last = rng.choice(sorted(leaves(tree), key=str))
        group = at(tree, path)
        if not gentle:
            change(tree, group, last, odd, rng)
        elif isinstance(group[last], str) and group[last].replace(".", "").isdecimal():
            group[last] = repr(abs(number(rng)))
        if not tree:
            return ""
    text = yaml.safe_dump(tree, default_flow_style=rng.choice([None, True, False]))
    for place, value in enumerate(odd):
        text = text.replace(f"'<{place}>'", value).replace(f"<{place}>", value)
    return damaged(text, rng) if not gentle and rng.random() < 0.2 else text


def at(tree, path):
    """Return the value at a path."""
    for key in path:
        tree = tree[key]
    return tree


def change(tree, group, last, odd, rng):
    """Change one value or key of a group in place; odd values enter the text later."""
    kind = rng.choice(["odd", "odd", "odd", "odd", "lose", "rename", "swap", "nest"])
    if kind == "rename" and isinstance(group, dict):
        group[rng.choice(NAMES)] = group.pop(last)
    elif kind == "lose":
        del group[last]
    elif kind == "swap":
        value = at(tree, rng.choice(sorted(leaves(tree), key=str)))
        # A copy, so that no value contains itself.
        group[last] = yaml.safe_load(yaml.safe_dump(value))
    elif kind == "nest":
        group[last] = rng.choice([[group[last]], {"start": group[last]}, [group[last]] * 40])
    else:
        group[last] = f"<{len(odd)}>"
        odd.append(rng.choice(ODD) if rng.random() < 0.6 else repr(number(rng)))


def number(rng):
    """Return a number of any magnitude."""
    exponent = rng.uniform(-12, 12) if rng.random() < 0.3 else rng.uniform(-1, 1)
    return rng.choice([-1, 1, 1, 1, 1, 1]) * 10.0**exponent


def damaged(text, rng):
    """Return a text with some characters or lines changed, removed or doubled."""
    for _ in range(rng.randint(1, 4)):
        begin = rng.randrange(len(text) + 1)
        end = begin + rng.choice([0, 1, 1, 5, 40])
        put = rng.choice(
            ["", "", ":", "\n", "\t", " ", "{", "]", "#", "'", '"', "\0", "\x85", "😀"]
        )
        text = text[:begin] + put + text[end:]
        if rng.random() < 0.3:
            lines = text.splitlines(keepends=True)
            lines.insert(rng.randrange(len(lines) + 1), rng.choice(lines or [""]))
            text = "".join(lines)
    return text


# Variables of all libraries that a command uses

#: Odd numbers, switches, names and paths.
_NONSENSE = ("abc", "-1", "0", "99999999999", "")
_PLACES = ("/proc", "/dev/null/x", "/sys/deep/folder", "")

VARIABLES = {
    "NUMBA_NUM_THREADS": _NONSENSE,
    "NUMBA_THREADING_LAYER": ("nonsense", "tbb", "omp", "workqueue", "safe", "threadsafe", ""),
    "NUMBA_THREADING_LAYER_PRIORITY": ("nonsense", "tbb omp", "tbb omp workqueue"),
    "NUMBA_DISABLE_JIT": ("1", "abc", "0"),
    "NUMBA_OPT": ("abc", "9", "max", "0"),
    "NUMBA_CPU_NAME": ("generic", "nonsense"),
    "NUMBA_CPU_FEATURES": ("", "+nonsense", "+sse2"),
    "NUMBA_BOUNDSCHECK": ("1", "abc"),
    "NUMBA_CACHE_DIR": _PLACES,
    "NUMBA_CACHE_LOCATOR_CLASSES": ("nonsense", "os.path.nonsense"),
    "NUMBA_DEBUG_CACHE": ("1", "abc"),
    "NUMBA_FUNCTION_CACHE_SIZE": ("abc", "0"),
    "OMP_NUM_THREADS": ("abc", "-1", "0", "1"),
    "MKL_NUM_THREADS": ("abc",),
    "OPENBLAS_NUM_THREADS": ("abc", "99999"),
    "MPLBACKEND": ("nonsense", "TkAgg", ""),
    "MPLCONFIGDIR": _PLACES,
    "MATPLOTLIBRC": ("/nonexistent", "."),
    "HOME": _PLACES,
    "XDG_CACHE_HOME": _PLACES,
    "XDG_CONFIG_HOME": _PLACES,
    "TMPDIR": _PLACES,
    "PATH": ("", "/nonexistent"),
    "LANG": ("nonsense", "C", "tr_TR.UTF-8"),
    "LC_ALL": ("nonsense", "POSIX"),
    "PYTHONIOENCODING": ("ascii", "latin-1", "utf-16"),
    "PYTHONUTF8": ("0", "1"),
    "PYTHONOPTIMIZE": ("1", "2"),
    "PYTHONUNBUFFERED": ("1",),
    "PYTHONDEVMODE": ("1",),
    "PYTHONMALLOC": ("malloc",),
    "TERM": ("dumb", "nonsense", ""),
    "COLUMNS": ("abc", "0", "-1", "1"),
    "LINES": ("abc", "0"),
    "NO_COLOR": ("1",),
    "FORCE_COLOR": ("1", "abc"),
    "TZ": ("nonsense", ":/dev/null"),
    "HDF5_USE_FILE_LOCKING": ("FALSE", "nonsense"),
    "HDF5_PLUGIN_PATH": ("/nonexistent",),
    "HDF5_DISABLE_VERSION_CHECK": ("abc",),
    "TYPER_USE_RICH": ("0", "abc"),
    "DASK_CONFIG": ("/nonexistent", "/dev/null"),
    "OPENBLAS_CORETYPE": ("nonsense",),
    "MALLOC_ARENA_MAX": ("1",),
    "COMP_WORDS": ("nonsense",),
}

#: Pairs of a variable and its value.
ENVIRONMENTS = [(name, value) for name, values in VARIABLES.items() for value in values]
