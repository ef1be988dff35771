"""Words that a shell completes: commands, options, scenes, kinds of pictures, and files."""

import os
import shutil
import subprocess
import sys

import pytest

from sweeps import plotting
from tests.helpers.commands import accepted
from tests.helpers.places import ROOT


def completed(monkeypatch, *words):
    """Return what the shell gets for the last of the words."""
    monkeypatch.setenv("COMP_WORDS", " ".join(["vibroimpact", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    monkeypatch.setenv("_VIBROIMPACT_COMPLETE", "complete_bash")
    return accepted().split()


def test_every_command_is_completed(monkeypatch):
    listed = accepted("--help").partition("Commands:\n")[2].splitlines()
    names = [line.split()[0] for line in listed if line[2:3].strip()]
    assert "run" in names and "bench" in names
    assert sorted(completed(monkeypatch, "")) == sorted(names)
    assert completed(monkeypatch, "pl") == ["plot"]
    assert completed(monkeypatch, "bench", "sp") == ["speed"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["plot", "--over"], ["--overlay"]),
        (["zoom", "a.h5", "--th"], ["--threads"]),
        (["export", "a.h5", "--rows", "s"], ["sections"]),
        (["explore", "--port", "none", "--no"], ["--no-browser"]),
        (["nonsense", "x"], []),
        (["run", "swe"], []),  # then the shell completes the names of files
        (["plot", "--kind", ""], list(plotting.KINDS)),
        (["init", ""], [path.stem for path in sorted((ROOT / "configs").glob("*.yaml"))]),
    ],
)
def test_a_word_is_completed(monkeypatch, words, expected):
    assert completed(monkeypatch, *words) == expected


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes_with_the_script_that_is_shown(folder):
    command = folder / "vibroimpact"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m sweeps.cli "$@"\n')
    command.chmod(0o755)
    script = """\
eval "$(vibroimpact --show-completion bash)"
COMP_WORDS=(vibroimpact plo) COMP_CWORD=1
_vibroimpact_completion vibroimpact
echo "${COMPREPLY[@]}"
"""
    environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "--norc", "-c", script], env=environment, capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("plot\n", "")
