"""Hints in reports and refusals at what helps: a key of the configuration, or another file."""

from pathlib import Path

import pytest

from sweeps import ConfigError, load_config
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.configurations import load
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


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("oscillator:\n\th: 0.1\n", 2),
        ("oscillator:\n  h: 0.1\n\tR: 0.8\n", 3),
        ("oscillator: {h: 0.1,\n\tR: 0.8}\n", 2),
        ("name:\ta\n", 1),
    ],
)
def test_a_tab_in_yaml(text, line):
    Path("tab.yaml").write_text(text)
    with pytest.raises(ConfigError, match=rf"tab\.yaml, line {line}, .*indent with spaces"):
        load_config("tab.yaml")


def test_other_faults_of_yaml_do_not_speak_of_tabs():
    for text in ("a: [1\n", "a: b: c\n", "name: 'a\tb\n"):
        Path("fault.yaml").write_text(text)
        with pytest.raises(ConfigError, match="not valid YAML") as refusal:
            load_config("fault.yaml")
        assert "spaces" not in str(refusal.value)


@pytest.mark.parametrize("ending", [".yaml", ".yml"])
@pytest.mark.parametrize("command", ["info", "plot", "attractors", "compare"])
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
    assert refused(*command, "missing.h5").endswith("error: missing.h5 does not exist\n")
    Path("results").mkdir()
    for there in ("results/massing.h5", "results/other.yaml", "results/running.h5.parts"):
        Path(there).touch()
    for given, meant in (("missing", "massing"), ("runing", "running")):
        said = f"results/{given}.h5 does not exist (did you mean results/{meant}.h5?)"
        assert said in refused(*command, f"results/{given}.h5")
    assert "does not exist" in refused(*command, "nowhere/missing.h5")
    if command[0] in ("run", "explore"):
        assert "(did you mean results/other.yaml?)" in refused(*command, "results/othr.yaml")
