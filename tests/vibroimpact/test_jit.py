"""The fused multiply-add, and a disk cache that never serves a stale kernel."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vibroimpact
from vibroimpact.jit import fma

# step_lanes() is in kernel/time_stepping.py, the helper it calls in step/integrators.py.
PROGRAM = """\
import numpy as np
import vibroimpact
from vibroimpact.kernel.time_stepping import step_lanes
from vibroimpact.kernel.workspace import LANES, LEVEL, POSITION, new_workspace
lanes = new_workspace(0).lanes
lanes[:] = 1.0
lanes[LEVEL : LEVEL + LANES] = np.inf
step_lanes(lanes, 1, np.array([[0.0], [0.25], [0.5]]), 0, 1)
print(vibroimpact.__file__)
print(lanes[POSITION])
print(sum(step_lanes.stats.cache_hits.values()), sum(step_lanes.stats.cache_misses.values()))
"""


def run(folder):
    """Run the program on the copy of the package in `folder`: its file, x_T, hits, misses."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "PYTHON"))}
    environment |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    environment["NUMBA_CACHE_DIR"] = str(folder / "cache")  # that of the original has it, too
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
    """Compiled, then read from the cache, then edited: the third run must compile again."""
    copy = tmp_path / "vibroimpact"
    shutil.copytree(
        Path(vibroimpact.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    assert run(tmp_path) == (2.75, 0, 1)
    assert run(tmp_path) == (2.75, 1, 0)
    helper = copy / "step/integrators.py"
    before = helper.read_text()
    after = before.replace("fma(xs, s, xc * c)", "fma(xs, s, 3.0 * xc * c)")
    assert after != before
    helper.write_text(after)
    assert run(tmp_path) == (3.75, 0, 1)


@pytest.mark.slow
def test_compiled_code_runs_without_all_that_numba_can_compile(tmp_path):
    """SciPy is most of it. A function that is not in the cache yet is compiled all the same."""
    program = f"""{PROGRAM}
import sys
print("scipy.linalg" in sys.modules)
from vibroimpact.kernel.time_stepping import map_of
print(map_of(lanes, 0)[1])
print("scipy.linalg" in sys.modules)
"""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    runs = [
        subprocess.run([sys.executable, "-c", text], env=environment, stdout=subprocess.PIPE)
        for text in (PROGRAM, program)
    ]
    first, second = (result.stdout.decode().splitlines()[1:] for result in runs)
    assert first == ["2.75", "0 1"]
    assert second == ["2.75", "1 0", "False", "(1.0, 1.0, 1.0, 1.0)", "True"]


@pytest.mark.slow
def test_two_processes_that_start_at_once_on_an_empty_cache(tmp_path):
    """Both wait until the other is ready to compile; both are right, and so is what they leave."""
    before, call = PROGRAM.split("step_lanes(lanes", 1)
    waiting = f"{before}print('ready', flush=True)\ninput()\nstep_lanes(lanes{call}"
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
        assert process.stdout.readline() == "ready\n"
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    told = [process.communicate()[0].splitlines() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert [lines[1] for lines in told] == ["2.75", "2.75"]
    third = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    assert third.stdout.splitlines()[1:] == ["2.75", "1 0"]


def test_fma_rounds_once():
    """(1 + e)^2 - (1 + 2 e) is e^2; rounded after the product it would be 0."""
    from numba import njit

    @njit
    def fused(a, b, c):
        return fma(a, b, c)

    e = 2.0**-30
    assert fused(1.0 + e, 1.0 + e, -(1.0 + 2.0 * e)) == e * e
    assert (1.0 + e) * (1.0 + e) - (1.0 + 2.0 * e) == 0.0


@pytest.mark.slow
def test_without_the_private_parts_of_numba_the_numbers_are_the_same(tmp_path):
    program = """
from pathlib import Path
from vibroimpact.jit.hooks import HOOKS
from vibroimpact.step.trigonometry import sin_cos
print(HOOKS, *map(float.hex, sin_cos(0.7)), sin_cos.targetoptions.get("_nrt"))
"""
    results = {}
    for switch in ("0", "1"):
        environment = os.environ | {"VIBROIMPACT_NUMBA_HOOKS": switch}
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / switch)
        result = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True
        )
        assert (result.returncode, result.stderr) == (0, "")
        results[switch] = result.stdout.split()
        assert list((tmp_path / switch).glob("compiled-*/**/*sin_cos*"))
    assert results["0"][0] == "False" and results["1"][0] == "True"
    assert results["0"][1:3] == results["1"][1:3]
    assert results["0"][3] == "None"
