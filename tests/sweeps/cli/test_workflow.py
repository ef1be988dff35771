"""The workflow that a page shows for CI: its commands, and what it keeps between two jobs."""

import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest
import yaml

from sweeps.config import scenes
from tests.helpers.commands import accepted
from tests.helpers.places import CONFIGS, ROOT
from tests.helpers.sweep_files import run_in
from vibroimpact.jit.cache import root


@pytest.mark.slow
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
    shutil.copytree(root(), cache)
    first, words = stored(), [shlex.split(command)[1:] for command in commands]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": cache}
    program = [sys.executable, "-m", "sweeps.cli", *words[0]]
    subprocess.run(program, cwd=tmp_path, env=environment, check=True)
    assert first and stored() == first
    accepted(*words[1])
