"""The fused multiply-add, and a disk cache that never serves a stale kernel."""

import math
import os
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import vibroimpact
from vibroimpact.jit import WAY, compiling, fma, trial
from vibroimpact.jit.way import _chosen
from vibroimpact.step.elementary import sin_cos

# time_to_release() is in step/contact.py, the helper it calls in step/elementary.py.
PROGRAM = """\
import vibroimpact
from vibroimpact import Oscillator
from vibroimpact.step.contact import is_held, time_to_release
pt = Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at()[0]
print(vibroimpact.__file__)
print(time_to_release(4.0, pt))
hits, misses = time_to_release.stats.cache_hits, time_to_release.stats.cache_misses
print(sum(hits.values()), sum(misses.values()))
"""
RELEASE = math.pi - 2.0  # from the phase 4 to 2 pi, at omega = 2


def run(folder):
    """Run the program on the copy of the package in `folder`: its file, time, hits, misses."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "PYTHON"))}
    environment |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    # A separate folder: the cache of the original package already holds the function.
    environment["NUMBA_CACHE_DIR"] = str(folder / "cache")
    out = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert Path(out[0]).is_relative_to(folder), "not the copy"
    return float(out[1]), *map(int, out[2].split())


@pytest.mark.slow
def test_an_edited_helper_in_another_file_changes_the_result(tmp_path):
    """Compiled, then edited: the second run must compile again."""
    copy = tmp_path / "vibroimpact"
    shutil.copytree(
        Path(vibroimpact.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    assert run(tmp_path) == (pytest.approx(RELEASE), 0, 1)
    helper = copy / "step/elementary.py"
    before = helper.read_text()
    after = before.replace("return -s if half >= 1.0 else s,", "return s,")
    assert after != before
    helper.write_text(after)
    assert run(tmp_path) == (0.0, 0, 1)


@pytest.mark.slow
def test_two_processes_that_start_at_once_on_an_empty_cache(tmp_path):
    """One compiles and the other waits for it; their results and their cache are right.

    It runs without all that numba can compile, of which SciPy is most; and a function that is not
    in the cache yet is compiled all the same.
    """
    before, call = PROGRAM.split("print(time", 1)
    waiting = f"{before}print('ready', flush=True)\ninput()\nprint(time{call}"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    both = [
        subprocess.Popen(
            [sys.executable, "-c", waiting],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    for process in both:
        assert [process.stdout.readline() for _ in range(2)][1] == "ready\n"
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    told = [process.communicate()[0].splitlines() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sorted(told) == [[repr(RELEASE), "0 1"], [repr(RELEASE), "1 0"]]
    third = f"""{PROGRAM}
import sys
print("scipy.linalg" in sys.modules)
print(is_held(pt))
print("scipy.linalg" in sys.modules)
"""
    done = subprocess.run(
        [sys.executable, "-c", third], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[1:] == [repr(RELEASE), "1 0", "False", "False", "True"]


def test_fma_rounds_once():
    """(1 + e)^2 - (1 + 2 e) is e^2; rounded after the product it would be 0."""
    from numba import njit

    @njit
    def fused(a, b, c):
        return fma(a, b, c)

    e = 2.0**-30
    assert fused(1.0 + e, 1.0 + e, -(1.0 + 2.0 * e)) == e * e
    assert (1.0 + e) * (1.0 + e) - (1.0 + 2.0 * e) == 0.0


@pytest.mark.parametrize(
    ("features", "warned"),
    [({"fma": False, "avx": True}, 1), ({"fma": False, "fma4": True}, 0), ({"fma": True}, 0),
     ({"neon": True}, 0)],
)  # fmt: skip
def test_a_processor_without_fma_is_named_once(monkeypatch, features, warned):
    """There the C library computes it, hundreds of times slower. Only x86 lists it."""
    osc = vibroimpact.Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0)
    vibroimpact.simulate(osc, 1)  # with the true features, which numba asks for once
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_features", lambda: features)
    compiling._warn_without_fma.cache_clear()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for _ in range(2):
            vibroimpact.simulate(osc, 1)
    assert len(told) == warned
    assert all("no fused multiply-add (FMA)" in str(one.message) for one in told)
    compiling._warn_without_fma.cache_clear()


#: Prints the way, how functions are compiled, and a result.
WAY_PROGRAM = """
from vibroimpact.jit import WAY
from vibroimpact.step.elementary import sin_cos
print(WAY.name, sin_cos.targetoptions.get("_nrt"), *map(float.hex, sin_cos(0.7)))
"""


def way(tmp_path, change):
    """Run the program after a change of numba, in every process: what it prints, and stderr."""
    (tmp_path / "sitecustomize.py").write_text(change)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    result = subprocess.run(
        [sys.executable, "-c", WAY_PROGRAM],
        env=environment | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    name, references, *values = result.stdout.split()
    assert values == [*map(float.hex, sin_cos(0.7))]
    assert references == {"private": "False", "options": "False", "plain": "None"}[name]
    assert list(tmp_path.glob(f"kept/compiled-*-{name}/**/*sin_cos*"))
    return name, result.stderr


@pytest.mark.parametrize(
    ("asked", "taken", "reason"),
    [
        ("", "private", "this version was tried"),
        ("private", "private", "VIBROIMPACT_NUMBA_HOOKS=private"),
        ("options", "options", "VIBROIMPACT_NUMBA_HOOKS=options"),
        ("0", "plain", "VIBROIMPACT_NUMBA_HOOKS=plain"),
        ("nonsense", "private", "this version was tried"),
    ],
)
def test_the_way_of_using_numba_can_be_asked_for(monkeypatch, asked, taken, reason):
    """The tests below compute with each way."""
    monkeypatch.setenv("VIBROIMPACT_NUMBA_HOOKS", asked)
    assert _chosen() == (taken, reason)
    assert asked or WAY == (taken, reason)


UNTRIED = "import numba; numba.__version__ = '99.0.0'\n"
MISSING = "import numba.core.codegen; del numba.core.codegen.JITCodeLibrary\n"
CRASHING = """
import os
from numba.core.compiler import CompileResult
rebuild = CompileResult._rebuild
def crash(context, data, *others):
    return os.abort() if data[0] == "whole" else rebuild(context, data, *others)
CompileResult._rebuild = crash
"""
NO_OPTION = "import numba.core.cpu; del numba.core.cpu._options_mixin.no_cfunc_wrapper\n"


@pytest.mark.parametrize("optimize", [0, 1, 2])
def test_a_wrong_result_fails_the_check_even_if_asserts_are_removed(optimize):
    source = Path(trial.__file__).read_text()
    names = {"__name__": trial.__name__}  # its options depend on the name of a module
    exec(compile(source, trial.__file__, "exec", optimize=optimize), names)
    names["compiled"] = lambda function, job: lambda job: (1.0, job.rows[:2])
    with pytest.raises(Exception, match=r"1\.0"):
        names["main"]()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "taken", "told"),
    [
        (UNTRIED, "private", "numba 99.0.0 is used with its private parts, .* a check held"),
        (UNTRIED + CRASHING, "options", r"options alone, .* its process ended with -\d"),
        (UNTRIED + MISSING + NO_OPTION, "plain", "in its plainest way, .* its options failed: Key"),
        (MISSING, "options", "options alone, .* cannot import name 'JITCodeLibrary'"),
    ],
    ids=["untried", "crash", "no private part or option", "tried, name removed"],
)
def test_an_unknown_numba_is_checked_once_and_named(tmp_path, change, taken, told):
    name, stderr = way(tmp_path, change)
    lines = [line for line in stderr.splitlines() if "NumbaWarning" in line]
    assert name == taken and len(lines) == 1 and re.search(told, lines[0]), stderr
    if change == UNTRIED:
        assert way(tmp_path, change) == (taken, "")
