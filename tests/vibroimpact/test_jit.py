"""The ways of using numba, and a disk cache that never serves a stale kernel."""

import math
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numba
import pytest

import vibroimpact
from vibroimpact.jit import WAY, cache, compiling, trial, way
from vibroimpact.jit.way import NumbaWarning, _chosen
from vibroimpact.step.elementary import sin_cos

PROGRAM = """\
import sys
import vibroimpact
from vibroimpact import Oscillator
from vibroimpact.step.contact import is_held, time_to_release
pt = Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at()[0]
print(vibroimpact.__file__, flush=True)
input()
print(time_to_release(4.0, pt))
hits = sum(time_to_release.stats.cache_hits.values())
print(hits, sum(time_to_release.stats.cache_misses.values()), "scipy.linalg" in sys.modules)
if hits:
    print(is_held(pt), "scipy.linalg" in sys.modules)
"""
RELEASE = math.pi - 2.0  # from the phase 4 to 2 pi, at omega = 2


def ready(folder):
    """Start the program with the copy of the package in `folder`, up to its input."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "PYTHON"))}
    # A separate folder: the cache of the original package already holds the function.
    environment |= {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    command = [sys.executable, "-c", PROGRAM]
    process = subprocess.Popen(command, env=environment, cwd=folder, **streams)
    assert Path(process.stdout.readline()).is_relative_to(folder), "not the copy"
    return process


def told(*processes):
    """Let the programs go on at once; return what each tells, in the order of its text."""
    for process in processes:
        process.stdin.write("\n")
        process.stdin.flush()
    lines = sorted(process.communicate()[0].splitlines() for process in processes)
    assert not any(process.returncode for process in processes)
    return lines


@pytest.mark.slow
def test_of_two_processes_one_compiles_and_the_other_waits(tmp_path):
    """The other runs without all that numba can compile, of which SciPy is most.

    A function that is not in the cache yet is compiled all the same.
    """
    shutil.copytree(Path(vibroimpact.__file__).parent, tmp_path / "vibroimpact")
    shutil.copytree(cache.root() / "numerics", tmp_path / "cache/numerics")
    first, second = told(ready(tmp_path), ready(tmp_path))
    assert first == [repr(RELEASE), "0 1 True"]
    assert second == [repr(RELEASE), "1 0 False", "False True"]


def test_an_edit_of_any_file_of_the_package_names_another_folder(tmp_path, monkeypatch):
    """Code is compiled again after an edit of a helper in another file, but not of a comment."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    helper = tmp_path / "package/room/helper.py"
    helper.parent.mkdir(parents=True)
    names = []
    for text in ("x = 1.0\n", "x = 1.0  # a number\n", "x = 2.0\n"):
        helper.write_text(text)
        names.append(cache.numerics_of(tmp_path / "package"))
    assert names[0] == names[1] != names[2]
    assert cache.NUMERICS in str(cache.cache_folder("private"))


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


@pytest.mark.parametrize(
    ("asked", "taken"),
    [("", None), ("odd", None), ("private", "private"), ("options", "options"), ("0", "plain")],
)
def test_the_way_of_using_numba_can_be_asked_for(monkeypatch, asked, taken):
    monkeypatch.setenv("VIBROIMPACT_NUMBA_HOOKS", asked)
    reason = f"VIBROIMPACT_NUMBA_HOOKS={taken}" if taken else "this version was tried"
    taken = taken or "private"
    assert _chosen() == (taken, reason)
    assert asked or WAY == (taken, reason)


#: Runs the trial, and prints how functions are compiled, and a result.
WAY_PROGRAM = """
from vibroimpact.jit.trial import run_trial
from vibroimpact.step.elementary import sin_cos
run_trial()
print(sin_cos.targetoptions.get("_nrt"), *map(float.hex, sin_cos(0.7)))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "references"), [("options", "False"), ("plain", "None")])
def test_every_way_gives_the_same_bits_and_keeps_its_code(tmp_path, name, references):
    shutil.copytree(cache.root() / "numerics", tmp_path / "numerics")
    environment = os.environ | {"VIBROIMPACT_NUMBA_HOOKS": name, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", WAY_PROGRAM]
    out = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    assert out.stdout.split() == [name, "compiled", references, *map(float.hex, sin_cos(0.7))]
    assert list(tmp_path.glob(f"compiled-*-{name}/**/*sin_cos*"))


@pytest.mark.parametrize("optimize", [0, 1, 2])
def test_a_wrong_result_fails_the_check_even_if_asserts_are_removed(optimize):
    source = Path(trial.__file__).read_text()
    names = {"__name__": trial.__name__}  # its options depend on the name of a module
    exec(compile(source, trial.__file__, "exec", optimize=optimize), names)
    names["compiled"] = lambda function, job: lambda job: (1.0, job.rows[:2])
    with pytest.raises(ArithmeticError, match=r"1\.0"):
        names["run_trial"]()


@pytest.fixture
def numba_99(monkeypatch):
    """Let the version of numba be one that was not tried."""
    monkeypatch.setattr(numba, "__version__", "99.0.0")


@pytest.fixture
def without_a_name(monkeypatch):
    """Let numba lack a name that the private parts import."""
    monkeypatch.delattr("numba.core.codegen.JITCodeLibrary")
    monkeypatch.delitem(sys.modules, "vibroimpact.jit.hooks")


@pytest.fixture
def changed(monkeypatch, tmp_path):
    """Return a function that changes numba in the processes of a check; what is known is none."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    monkeypatch.syspath_prepend(tmp_path)
    return (tmp_path / "sitecustomize.py").write_text


#: In place of the trial: both processes tell that they have compiled, or the second one crashes.
STAND_IN = """
import os
compiled = os.environ["NUMBA_CACHE_DIR"] + "/code"
if os.path.exists(compiled) and CRASHES:
    os.abort()
open(compiled, "w").close()
print("private compiled", flush=True)
os._exit(0)
"""
NO_OPTION = "import numba.core.cpu; del numba.core.cpu._options_mixin.no_cfunc_wrapper\n"


def assert_told_once(taken, told):
    with pytest.warns(NumbaWarning, match=told) as warned:
        assert _chosen().name == _chosen().name == taken
    assert len(warned) == 1


@pytest.mark.slow
def test_an_unknown_numba_is_checked_once_and_named(changed, numba_99):
    changed("")
    assert_told_once("private", "numba 99.0.0 is used with its private parts, .* a check held")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("crashes", "told"), [(True, r"its process ended with -\d"), (False, "private compiled")]
)
def test_a_check_whose_second_process_crashes_or_loads_nothing_has_failed(
    monkeypatch, changed, numba_99, crashes, told
):
    check = way._why_it_fails
    monkeypatch.setattr(way, "_why_it_fails", lambda name: name == "private" and check(name))
    changed(STAND_IN.replace("CRASHES", str(crashes)))
    assert_told_once("options", f"options alone, .* {told}")


@pytest.mark.slow
def test_without_a_private_part_the_plainest_way_is_taken(changed, numba_99, without_a_name):
    changed(NO_OPTION)
    assert_told_once("plain", "in its plainest way, .* its options failed: KeyError")


def test_a_name_that_a_tried_numba_lacks_is_told(monkeypatch, changed, without_a_name):
    monkeypatch.setattr(way, "_why_it_fails", {"options": ""}.get)
    assert_told_once("options", "options alone, .* cannot import name 'JITCodeLibrary'")
