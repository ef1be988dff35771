"""The workflow that a page shows for CI: its commands, and what it keeps between two jobs."""

import os
import re
import shutil
import subprocess
import sys

import pytest
import yaml

from sweeps.config import scenes
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

    program = tmp_path / "bin" / "vibroimpact"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m sweeps.cli "$@"\n')
    program.chmod(0o755)
    path = f"{program.parent}:{os.environ['PATH']}"
    usual = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    text = scenes()["chatter"].replace("num: 4096", "num: 64")
    (tmp_path / "sweep.yaml").write_text(text)
    run_in(tmp_path, text, name="reference.h5")

    # The first job stores what this process has in its own cache, which takes half a minute.
    shutil.copytree(root(), cache)

    def stored_by_a_job():
        for command in commands[:2]:
            environment = usual | {"NUMBA_CACHE_DIR": cache}
            subprocess.run(["sh", "-c", command], cwd=tmp_path, env=environment, check=True)
        files = (path for path in (tmp_path / kept).rglob("*") if path.is_file())
        return {path: path.stat().st_mtime_ns for path in files}

    first = stored_by_a_job()
    (tmp_path / "new.h5").unlink()
    assert first and stored_by_a_job() == first
