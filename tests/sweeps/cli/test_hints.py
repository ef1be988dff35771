"""Hints at what helps: a key of the configuration, another file; words that a shell completes."""

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sweeps import ConfigError, load_config, plotting
from sweeps.cli.common import opened_in_si, resuming
from sweeps.plotting.contents import numbers_of
from sweeps.text import command, shown_count
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.configurations import load
from tests.helpers.places import ROOT
from tests.helpers.sweep_files import run_in

ONE_IMPACT = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 2.3, stop: 2.4, num: 8}, f: 1.0}
record: {periods: 16, impacts: 4, diagnostics: [period]}
"""
#: Between the graze of the free oscillation and the fold of 1/1 two motions are stable.
TWO_MOTIONS = """\
oscillator: {h: 0.05, R: 0.8, clearance: 1.5, f: 1.0, omega: {start: 1.2, stop: 1.7, num: 26}}
record: {transient: 400, periods: 64, impacts: 8, diagnostics: [period]}
"""
AUTO = "record.transient: auto"


@pytest.mark.parametrize("num", [8, 1])
def test_many_motions_on_their_way_name_the_transient_auto(folder, num):
    ends = [] if num == 8 else ["oscillator.omega=2.3"]
    path = run_in(folder, ONE_IMPACT, "record.transient=4", *ends, name="short.h5")
    said = accepted("info", path)
    assert "on its way to" in said and said.count(AUTO) == 1
    load(ONE_IMPACT, "record.transient=auto", path=Path("c.yaml"))  # as the hint says
    Path("c.yaml").write_text(ONE_IMPACT)
    ran = accepted("run", "c.yaml", *(f"--set={each}" for each in ["record.transient=4", *ends]))
    assert AUTO in ran
    for transient in ("auto", "400"):
        path = run_in(folder, ONE_IMPACT, f"record.transient={transient}", *ends, name="long.h5")
        assert AUTO not in accepted("info", path)
        path.unlink()


def test_a_configuration_in_place_of_its_file_names_the_command_or_the_file():
    Path("rig.yaml").write_text(SMALL)
    message = refused("plot", "rig.yaml")
    assert "rig.yaml is not an HDF5 file; to compute it: vibroimpact run rig.yaml" in message
    accepted("run", "rig.yaml")
    assert "HDF5 file; the output of rig.yaml is small.h5\n" in refused("info", "rig.yaml")
    assert "directory" in refused("info", ".")
    Path("other.yaml").write_text("no: configuration\n")
    assert refused("info", "other.yaml").endswith("other.yaml is not an HDF5 file\n")
    Path("rig.yaml").rename("small.yaml")
    os.truncate("small.h5", 10_000)  # a damaged file needs no hint at itself
    assert "small.yaml" not in refused("info", "small.h5")


@pytest.mark.parametrize(
    ("command", "ending"), [("info", ".yml"), ("plot", ".yaml"), ("compare", ".yaml")]
)
def test_a_missing_file_names_what_its_configuration_wrote(command, ending):
    Path("results").mkdir()
    config = Path(f"rig{ending}")
    config.write_text(SMALL + "output: results/data.h5\n")
    others = ["rig.h5"] if command == "compare" else []
    message = refused(command, "rig.h5", *others)
    assert f"rig.h5 does not exist; to compute it: vibroimpact run rig{ending}" in message
    accepted("run", config)
    message = refused(command, "rig.h5", *others)
    assert f"rig.h5 does not exist; the output of rig{ending} is results/data.h5" in message
    config.write_text("nothing: valid\n")
    assert refused(command, "rig.h5", *others).endswith("rig.h5 does not exist\n")


def test_a_motion_that_is_lost_to_another_names_follow(folder):
    path = run_in(folder, TWO_MOTIONS, name="alone.h5")
    said = accepted("info", path, "--bifurcations")
    assert "basin" in said and "follow: {axis: omega, direction: up}" in said
    up = "follow: {axis: omega, direction: up}\n"
    path = run_in(folder, TWO_MOTIONS + up, name="up.h5")
    said = call("info", path, "--bifurcations").stdout
    assert "1/1 -> 1/0" in said and "follow:" not in said


@pytest.mark.parametrize("command", [["run"], ["explore", "--no-browser"], ["info"], ["plot"]])
def test_a_missing_file_names_the_nearest(command):
    Path("unlike.h5").touch()
    for name in ("missing.h5", "unl"):  # a file has its name, and not its beginning alone
        assert refused(*command, name).endswith(f"error: {name} does not exist\n")
    Path("results").mkdir()
    for there in ("results/massing.h5", "results/other.yaml", "results/running.h5.parts"):
        Path(there).touch()
    for given, meant in (("missing", "massing"), ("runing", "running")):
        said = f"results/{given}.h5 does not exist (did you mean results/{meant}.h5?)"
        assert said in refused(*command, f"results/{given}.h5")
    assert "does not exist" in refused(*command, "nowhere/missing.h5")
    if command[0] in ("run", "explore"):
        assert "(did you mean results/other.yaml?)" in refused(*command, "results/othr.yaml")


#: Names that begin like an option, that a shell reads otherwise, and that a terminal would hide.
ODD_NAMES = ["-o.h5", "--.h5", "a b's.h5", "a\xa0b$HOME`.h5", "\u202eé'\\\udcff.h5"]


@pytest.mark.skipif(os.name != "posix", reason="needs bash")
@pytest.mark.parametrize("name", ODD_NAMES)
def test_a_command_that_is_named_has_the_same_words_in_a_shell(name):
    """And a path that begins with a dash is no option of it."""
    text = command("plot", Path(name), "-o", name)
    assert text.isprintable()
    shown = f"{sys.executable} -c 'import sys; print(ascii(sys.argv[1:]))'"
    script = f'vibroimpact() {{ {shown} "$@"; }}; {text}'
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    kind, path, *words = ast.literal_eval(done.stdout)
    assert (kind, words) == ("plot", ["-o", name])
    assert Path(path) == Path(name) and not path.startswith("-")


@pytest.mark.parametrize("name", ["-small.h5", "--small.h5"])
def test_the_command_after_a_run_is_accepted(small_file, name, unpainted):
    said = accepted("run", "small.h5", f"--output={name}")
    assert (last := said.splitlines()[-1]).startswith("next: vibroimpact plot ")
    assert accepted(*shlex.split(last)[2:])
    Path(name).unlink()
    Path(name).with_suffix(".yaml").write_text(f"output: {name}\n{SMALL}")
    message = refused("info", f"./{name}").strip()
    words = shlex.split(message.partition("to compute it: vibroimpact ")[2])
    assert accepted(*words)


def test_the_command_that_resumes_keeps_options_before_the_files(monkeypatch):
    words = ["vibroimpact", "run", "-o", "a.h5", "--overwrite", "--", "-s.yaml"]
    monkeypatch.setattr(sys, "argv", words)
    assert resuming() == "vibroimpact run -o a.h5 --resume -- -s.yaml"
    monkeypatch.setattr(sys, "argv", words[:5])
    assert resuming() == "vibroimpact run -o a.h5 --resume"


#: Every door through which a path comes, with an option or a key for a file that is missing.
DOORS = [
    ("run", "{}/s.yaml"), ("run", "{}/s.h5"), ("run", "sweep.yaml", "-o", "{}/s.h5"),
    ("run", "sweep.yaml", "--set", "output='{}/s.h5'"),
    ("run", "sweep.yaml", "--set", "points='{}/p.csv'"),
    ("explore", "{}/s.h5", "--no-browser"), ("bench", "accuracy-speed", "{}/s.yaml"),
    ("bench", "paper", "-o", "{}/s.png"), ("bench", "speed", "--json", "{}/s.json"),
    ("plot", "{}/s.h5"), ("plot", "small.h5", "-o", "{}/s.png"),
    ("plot", "small.h5", "--overlay", "{}/o.csv"),
    ("plot", "small.h5", "--exact", "--csv", "{}/o.csv"),
    ("info", "{}/s.h5"), ("info", "small.h5", "--bifurcations", "--csv", "{}/s.csv"),
    ("attractors", "{}/s.h5"), ("integrity", "{}/s.h5"), ("compare", "small.h5", "{}/s.h5"),
    ("export", "{}/s.h5", "-o", "a.csv"), ("export", "small.h5", "-o", "{}/s.csv"),
    ("zoom", "{}/s.h5", "omega=2:3"), ("zoom", "small.h5", "omega=2:3", "-o", "{}/s.h5"),
]  # fmt: skip


@pytest.mark.parametrize("typed", ["~", "~nobody", "$HOME", "results/${OUT}", "%OUT%/a"])
def test_what_only_a_shell_replaces_is_named_at_every_door(small_file, typed):
    Path("sweep.yaml").write_text(SMALL + "output: other.h5\n")
    word = typed.removeprefix("results/").removesuffix("/a")
    for door in DOORS if typed == "~" else DOORS[:1]:
        message = refused(*(part.format(typed) for part in door))
        assert message.endswith(f"; only a shell replaces {word}\n"), (door, message)


def test_a_missing_table_names_the_nearest(small_file):
    Path("points.csv").touch()
    message = refused("plot", "small.h5", "--overlay", "pionts.csv")
    assert "pionts.csv does not exist (did you mean points.csv?)" in message


def test_one_thing_is_singular():
    assert [shown_count(number, "point") for number in (0, 1, 2, 1234)] == [
        "0 points", "1 point", "2 points", "1,234 points",
    ]  # fmt: skip
    assert shown_count(1, "branch") == "1 branch" and shown_count(2, "branch") == "2 branches"
    assert shown_count(1.0 - 1e-12, "period", ".6g") == "1 period"


#: A single thing as if it were several.
SEVERAL = re.compile(r"(?<![\d.,/])1[ \xa0](?:(?:forcing|parameter|exact)[ \xa0])?[a-z]+s\b")


@pytest.mark.slow
def test_no_text_of_a_single_period_is_in_the_plural():
    record = "record: {transient: 1, periods: 1, impacts: 1, trajectory: {every: 1}}"
    for name, omega in (("point", "[2.0]"), ("line", "[2.0, 2.1]")):
        text = SMALL.replace("{start: 1.5, stop: 3.0, num: 5}", omega).replace("[0.0, 0.1]", "0")
        text = text.replace("name: small", f"name: {name}").replace("steps_per_period: 20", "")
        Path(f"{name}.yaml").write_text(re.sub("record: .*", record, text))
        said = accepted("run", f"{name}.yaml", "--dry-run")
        said += call("run", f"{name}.yaml").output + accepted("info", f"{name}.h5")
        said += accepted("compare", f"{name}.h5", f"{name}.h5")
        for rows in ("points", "sections", "impacts"):
            said += call("export", f"{name}.h5", "-o", f"{rows}.csv", "--rows", rows).output
        for kind in ("bifurcation",) if name == "line" else ("section", "trajectory"):
            accepted("plot", f"{name}.h5", "--kind", kind, "-o", f"{name}-{kind}.svg")
        said += "".join(path.read_text() for path in Path().glob("*.svg"))
        assert "record 1 period" in said.replace("\xa0", " ") and SEVERAL.findall(said) == []


# Words that a shell completes: commands, options, scenes, kinds of pictures


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
        (["explore", "--port", "none", "--no"], ["--no-browser"]),
        (["export", "a.h5", "--rows", "s"], ["sections"]),
        (["plot", "a.h5", "--quantity", "mean"], ["mean_force"]),
        (["nonsense", "x"], []),
        (["run", "swe"], []),  # then the shell completes the names of files
        (["plot", "--kind", ""], list(plotting.KINDS)),
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
