"""Words that a shell completes: commands, options, scenes, kinds of pictures, and files."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sweeps import ConfigError, load_config, plotting
from sweeps.cli.common import opened_in_si
from sweeps.plotting.contents import numbers_of
from tests.helpers.commands import SMALL, accepted
from tests.helpers.places import ROOT
from tests.helpers.sweep_files import run_in


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
        (["export", "a.h5", "--rows", "s"], ["sections"]),
        (["explore", "--port", "none", "--no"], ["--no-browser"]),
        (["nonsense", "x"], []),
        (["run", "swe"], []),  # then the shell completes the names of files
        (["plot", "--kind", ""], list(plotting.KINDS)),
        (["run", "a.yaml", "--set", "oscillator.om"], ["oscillator.omega="]),
        (
            ["zoom", "a.h5", "omega=2:3", "--set", "record.t"],
            ["record.transient=", "record.trajectory="],
        ),
        (
            ["run", "--set", "oscillator.R.s"],
            [f"oscillator.R.{key}=" for key in ("start", "stop", "spacing", "step")],
        ),
        (["run", "--set", "start"], ["start=", "start.x0=", "start.v0=", "start.phase="]),
        (["plot", "a.h5", "--below", "l"], ["lyapunov"]),
        (["plot", "a.h5", "--quantity", "mean"], ["mean_force"]),
        (["init", ""], [path.stem for path in sorted((ROOT / "configs").glob("*.yaml"))]),
    ],
)
def test_a_word_is_completed(monkeypatch, words, expected):
    assert completed(monkeypatch, *words) == expected


def test_every_key_that_is_completed_can_be_set(monkeypatch):
    """Each is taken for a key, and only its value is refused."""
    keys = completed(monkeypatch, "run", "--set", "")
    assert len(keys) == len(set(keys)) > 40 and {"name=", "oscillator.h=", "record="} <= {*keys}
    for key in keys:
        with pytest.raises(ConfigError) as error:
            load_config({}, [f"{key}[[0]]"])
        assert "unknown" not in str(error.value) and "there is no" not in str(error.value)


def test_the_numbers_that_are_completed_are_those_of_pictures(monkeypatch):
    names = completed(monkeypatch, "plot", "a.h5", "--below", "")
    everything = "record={transient: auto, periods: 2, diagnostics: [period, lyapunov, extremes]}"
    with opened_in_si(run_in(Path(), SMALL, everything)) as sweep:
        assert {*names} == {*numbers_of(sweep)} - {"omega", "clearance"}  # without its axes


def test_the_help_lists_the_scenes():
    scenes = [path.stem for path in sorted((ROOT / "configs").glob("*.yaml"))]
    shown = accepted("init", "--help").partition("Scenes:")[2]
    assert shown.replace(",", " ").split() == scenes


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
    command = ["bash", "--norc", "-c", script]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("plot\n", "")
