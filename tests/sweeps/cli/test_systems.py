"""The command line on systems that are not POSIX, simulated, and in the workflow for CI."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest
import xarray as xr
import yaml

from sweeps import load_config, run_sweep
from sweeps.cli.common import scenes
from tests.helpers.commands import accepted
from tests.helpers.interruptions import KINDS, SWEEP, hear, share_written, wait_until
from tests.helpers.places import CONFIGS, ROOT
from tests.helpers.sweep_files import data, run_in
from vibroimpact.jit.cache import cache_folder, root
from vibroimpact.jit.way import WAY

CONFIG = SWEEP
SCRIPT = ROOT / "tests/helpers/without_posix.py"
#: As many points as make two blocks.
CHANGES = [*KINDS[1], "oscillator.omega.num=600"]
SETTINGS = [word for setting in CHANGES for word in ("--set", setting)]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="asks Linux what is open"),
]


@contextmanager
def process(*words):
    """Start commands, and kill the remaining ones at the end."""
    command = [sys.executable, str(SCRIPT), *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=hear) as started:
        try:
            yield started
        finally:
            started.kill()


@pytest.mark.cluster
def test_a_run_that_is_killed_goes_on_and_every_command_works():
    """First the live picture, which is shown until an interrupt ends it."""
    run = ("run", "sweep.yaml", "--quiet", *SETTINGS, "--threads", "1")
    with process("--one-block", *run) as killed:
        wait_until(lambda: share_written(Path("sweep.h5")) or killed.poll() is not None, "a block")
        killed.kill()
    assert 0.0 < share_written(Path("sweep.h5")) < 1.0
    few = ("--set", "oscillator.omega.num=50", "-o", "few.h5")
    commands = [
        ["explore", "sweep.yaml", "--no-browser"],
        [*run, "--resume"],
        ["run", "sweep.yaml", "--quiet", *few],
        ["run", "sweep.yaml", "--quiet", *few, "--overwrite"],
        ["info", "sweep.h5"],
        ["zoom", "few.h5", "omega=2.5:2.6", "-o", "zoom.h5"],
        ["export", "sweep.h5", "-o", "sweep.csv"],
        ["export", "sweep.h5", "-o", "sweep.csv"],
        ["run", "few.h5", "--quiet", "--dask", "local:1", "-o", "cluster.h5"],
    ]
    words = [word for command in commands for word in ("--", *command)][1:]
    with process(*words) as done:
        with urllib.request.urlopen(done.stdout.readline().strip()) as answer:
            assert answer.status == 200
        done.send_signal(signal.SIGINT)
        done.communicate()
        assert done.returncode == 0
    assert Path("zoom.png").stat().st_size
    config = load_config("sweep.yaml", CHANGES)
    xr.testing.assert_identical(data("sweep.h5"), data(run_sweep(config, "whole.h5")))
    xr.testing.assert_identical(data("cluster.h5"), data("few.h5"))


def test_a_second_job_compiles_nothing(tmp_path):
    page = (CONFIGS / "clusters-and-ci.md").read_text()
    block = re.search(r"^## In CI$.*?^```yaml$(.*?)^```$", page, re.MULTILINE | re.DOTALL)[1]
    job = yaml.safe_load(block)["jobs"]["sweep"]
    (kept,) = {step["with"]["path"] for step in job["steps"] if "cache" in step.get("uses", "")}
    cache = job["env"]["NUMBA_CACHE_DIR"].replace("${{ github.workspace }}", str(tmp_path))
    assert cache == str(tmp_path / kept)
    commands = [step["run"] for step in job["steps"] if "run" in step]
    assert commands.pop(0).startswith("pip install ./vibroimpact")
    assert [command.split()[1] for command in commands] == ["run", "compare", "bench"]

    text = scenes()["chatter"].replace("num: 4096", "num: 64")
    (tmp_path / "sweep.yaml").write_text(text)
    run_in(tmp_path, text, name="reference.h5")

    def stored():
        files = (path for path in (tmp_path / kept).rglob("*") if path.is_file())
        return {path: path.stat().st_mtime_ns for path in files}

    # The first job stores what this process has in its own cache, which takes half a minute.
    for name in (cache_folder(WAY.name).name, "numerics"):
        shutil.copytree(root() / name, Path(cache, name))
    first, words = stored(), [shlex.split(command)[1:] for command in commands]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": cache}
    program = [sys.executable, "-m", "sweeps.cli", *words[0]]
    subprocess.run(program, cwd=tmp_path, env=environment, check=True)
    assert first and stored() == first
    accepted(*words[1])
