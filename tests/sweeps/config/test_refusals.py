"""Refused configurations: messages with file, line, key, given value and allowed values."""

import pytest

from sweeps.config.loading import load_config
from sweeps.errors import ConfigError
from sweeps.text import printable
from tests.helpers.configurations import load, oscillator_yaml, refusal
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import IMPACT_RULES


@pytest.mark.parametrize(
    ("values", "key", "given", "allowed"),
    [
        ({"R": "1.2"}, "oscillator.R", "1.2", "a number from 0 to 1"),
        ({"h": "-1"}, "oscillator.h", "-1", ">= 0"),
        ({"h": "nan"}, "oscillator.h", "nan", "finite number >= 0"),
        ({"f": "yes"}, "oscillator.f", "yes", "finite number >= 0"),
        ({"h": "[]"}, "oscillator.h", "[]", "a list of such numbers"),
        ({"R": "{start: 0, stop: 1.2, num: 3}"}, "oscillator.R", "contains 1.2,", "from 0 to 1"),
        ({"f": "{start: 0, stop: 1, num: 0}"}, "oscillator.f.num", "0", "an integer from 1"),
        ({"f": "{start: x, stop: 1, num: 2}"}, "oscillator.f.start", "x", "finite number"),
        ({"f": "{start: 0, stop: 1, num: 1}"}, "oscillator.f", "num: 1", "to be equal"),
        ({"f": "{start: 1, stop: 1, num: 9}"}, "oscillator.f", "num: 9", "to differ"),
        ({"h": "[0.1, 0.2, 0.1]"}, "oscillator.h", "has the value 0.1 twice", "a finite number"),
        ({"f": "{start: 0, stop: 1, num: 2, spacing: log}"}, "oscillator.f", "log", "start > 0"),
        ({"f": "{start: 0, stop: 1, num: 2, spacing: cubic}"}, "oscillator.f.spacing", "cubic",
         "linear or log"),
    ],
)  # fmt: skip
def test_refused_values(values, key, given, allowed):
    message = refusal("# a comment\n" + oscillator_yaml(**values))
    assert message.count("\n") == 0
    assert "sweep.yaml, line 2: " in message
    assert f"{key} = " in message and given in message and allowed in message


@pytest.mark.parametrize(
    ("line", "key", "given", "allowed"),
    [
        ("method: {integrator: newmrak}", "method.integrator", "newmrak",
         "is unknown (did you mean newmark?); expected: integrator between impacts: "
         + ", ".join(INTEGRATORS)),
        ("method: {impact: reduced}", "method.impact", "reduced", ", ".join(IMPACT_RULES)),
        ("record: {periods: 0}", "record.periods", "0", "an integer from 1"),
        ("record: {phase: 6.2832}", "record.phase", "6.2832", "< 2 pi"),
        ("start: {phase: [0, 7]}", "start.phase", "[0, 7]", "a number >= 0 and < 2 pi"),
        ("record: {trajectory: true}", "record.trajectory", "true", "false, or {every: k}"),
        ("record: {trajectory: {every: 0}}", "record.trajectory.every", "0", "an integer from 1"),
        ("record: 3", "record", "3", "a mapping with keys among transient, longest, periods"),
        ("method: {allow_unstable: 2}", "method.allow_unstable", "2", "true or false"),
        ("method:", "method", "(nothing)", "a mapping with keys among integrator"),
        ("name: a/b", "name", "a/b", "without slashes"),
        ("output: {a: b}", "output", "{a: b}", "a path"),
        ("name: ''", "name", "(nothing)", "without slashes"),
        ("record: {periods: 1e7}", "record.periods", "1e7", "from 1 to 1,000,000"),
        ("record: {transient: -1}", "record.transient", "-1", "an integer from 0"),
    ],
)  # fmt: skip
def test_refused_settings(line, key, given, allowed):
    message = refusal(oscillator_yaml() + line + "\n")
    assert message.count("\n") == 0
    assert "sweep.yaml, line 2: " in message
    assert f"{key} = {given}" in message and allowed in message


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("oscillator:\n  h: 0.1\n  R: 1\n  omga: 1\n  omega: 1\n  f: 1\n",
         ["line 4: unknown key oscillator.omga (did you mean omega?)",
          "keys among h, R, omega, f, p, clearance"]),
        ("oscillator:\n  h: 0.1\n  R: 1\n  h: 0.2\n",
         ["line 4: oscillator.h is given twice", "line 2"]),
        ("name: a\noscillator:\n  h: 0.1\n  R: 1\n  omega: 1\n",
         ["line 2: oscillator.f is missing; expected: forcing amplitude"]),
        ("name: a\n", ["line 1: oscillator is missing"]),
    ],
)  # fmt: skip
def test_keys_that_are_unknown_missing_or_given_twice(text, parts):
    message = refusal(text)
    for part in parts:
        assert part in message


def test_a_misspelt_key_is_not_reported_missing_as_well():
    message = refusal("oscilator: {h: 1}\n")
    assert "unknown key oscilator (did you mean oscillator?)" in message
    assert message.count("\n") == 0
    message = refusal(oscillator_yaml().replace("omega", "omga").replace("f: ", "x: "))
    assert "omega is missing" not in message
    assert "oscillator.f is missing" in message
    message = refusal("oscillator: {damping: 0.1, restitution: 0.8, frequency: 2, F: 1}\n")
    assert message.count("\n") == 3 and "missing" not in message


@pytest.mark.parametrize(("values", "errors"), [("[[1], [2]]", 2), ("[[1, 2], 3]", 1)])
def test_a_nested_list_is_reported_once_per_item(values, errors):
    message = refusal(oscillator_yaml(h=values))
    assert message.count("is not a number") == errors
    assert len(message.splitlines()) == errors


@pytest.mark.parametrize(
    ("place", "keys"),
    [
        ("oscillator.", {"gap": "clearance", "r": "R", "ω": "omega", "x0": "start.x0"}),
        ("oscillator.", {"coefficient-of-restitution": "R", "f.points": "num", "omega_0": "p"}),
        ("", {"method.solver": "integrator", "record.skip": "transient", "filename": "output"}),
        ("", {"omega": "oscillator.omega", "gap": "oscillator.clearance"}),
        ("", {"integrator": "method.integrator", "phase": "start.phase or record.phase"}),
    ],
)
def test_a_name_of_other_programs_leads_to_the_key(place, keys):
    text = oscillator_yaml(f="{start: 1, stop: 2, num: 2}") + "method: {}\nrecord: {}\n"
    for name, key in keys.items():
        message = refusal(text, [f"{place}{name}=1"])
        assert f"unknown key {place}{name} (did you mean {key}?)" in message
        assert message.count("\n") == 0


def test_of_many_errors_the_first_are_said_and_the_number_of_all():
    message = refusal(oscillator_yaml(h=f"[{', '.join('a' * 6_000)}]"))
    lines = message.splitlines()
    assert "line 1: oscillator.h[7] = a is not a number" in lines[7]
    assert lines[8].endswith("sweep.yaml: and 5,992 errors more") and len(lines) == 9


def test_an_escape_that_is_no_character_is_refused():
    for name in (r"\U00110000", r"\UFFFFFFFF", r"\uD800", r"\ude00\ud83d"):
        assert "sweep.yaml" in refusal(f'name: "{name}"\n')
    others = r'output: "\uDFFF.h5"', r'"\uD800": 1', r'oscillator: {h: "\UFFFFFFFF"}'
    assert all("sweep.yaml" in refusal(text + "\n") for text in others)
    message = refusal(oscillator_yaml(), [r'oscillator.h="\UFFFFFFFF"'])
    assert "override oscillator.h=" in message


def test_two_escapes_of_16_bits_are_the_character_that_json_means():
    assert load(rf'name: "\ud83d\ude00"{chr(10)}{oscillator_yaml()}').name == "😀"


def test_digits_of_other_scripts_are_no_numbers():
    assert "oscillator.h = １ is not a number" in refusal(oscillator_yaml(h="１"))
    text = f"{oscillator_yaml()}record: {{periods: ١٢}}\n"
    assert "record.periods = ١٢ is not an integer" in refusal(text)


def test_a_long_key_is_cut_and_an_empty_one_named():
    long, text = "k" * 900, oscillator_yaml()
    keys = long, f"oscillator.{long}", f"oscillator.h.{long}", "k." * 400 + "k"
    messages = [refusal(text, [f"{key}=1"]) for key in keys]
    for message in (refusal(f"{text}{long}: 1\n"), *messages):
        assert "k..." in message and len(message) < 500
    assert "unknown key (nothing);" in refusal(f'{oscillator_yaml()}"": 1\n')


@pytest.mark.parametrize("escape", [r"\x1b", r"\x9b", r"\x7f", r"\r", "/", r"\\"])
def test_a_name_with_a_control_character_or_a_slash_is_refused(escape):
    message = refusal(f'name: "a{escape}[31m"\n{oscillator_yaml()}')
    assert f"has the character '{escape}', which is not allowed; expected: name of" in message
    assert "without slashes and control characters" in message


def test_to_yaml_can_be_shown_and_read_back():
    name = "\u202egnp.x \u200b é"  # written from right to left
    config = load(f'name: "{name}"\n{oscillator_yaml()}')
    written = config.to_yaml()
    assert name not in written and printable(written) == written
    assert load(written).name == name
    assert "name: é" in load(f"name: é\n{oscillator_yaml()}").to_yaml()


@pytest.mark.parametrize(
    ("x0", "clearance"),
    [("0.5", "0.2"), ("[-1, 0.5]", "0.2"), ("0.5", "[1, 0.2]"),
     ("{start: 0, stop: 0.5, num: 2}", "{start: 0.2, stop: 3, num: 4}")],
)  # fmt: skip
def test_start_beyond_the_stop(x0, clearance):
    message = refusal(oscillator_yaml(clearance=clearance) + f"start: {{x0: {x0}}}\n")
    assert "line 2: start.x0: x0 = 0.5 lies beyond the stop at clearance = 0.2" in message
    assert "every x0 must be <= every clearance" in message
    message = refusal("name: a\n" + oscillator_yaml(clearance="-0.1"))
    assert "line 2: oscillator.clearance: x0 = 0 lies beyond the stop" in message


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("a: [1, 2\nb: 3\n", ["line 2, column 2", "not valid YAML"]),
        ("a:\n\t- b\n", ["line 2, column 1", "not valid YAML", "indent with spaces"]),
        ("oscillator:\n  h:0.1\n  R:0.8\n  omega: 1\n",
         ["line 4", "the space after one is missing"]),
        ("name: sweep: first\n", ["line 1", "a text with a colon needs quotes"]),
        (r'output: "C:\data\x.h5"', ["line 1", "single quotes"]),
        ("a:\n  b: 1\n c: 2\n", ["line 3, column 2", "need the same indentation"]),
        ("a: 1\n---\nb: 2\n", ["line 2, column 1", "not valid YAML: expected a single document"]),
        ("a: !!python/object:os.system x\n", ["line 1, column 4", "tags are not allowed"]),
        ("a: &x [1]\nb: *x\n", ["line 2, column 4", "aliases"]),
        ("a: 1\nb: \x07\n", ["line 2: not valid YAML: it has the character '\\x07', which"]),
        ("a: \x00\n", ["line 1: not valid YAML: it has the character '\\x00'"]),
        ("[" * 17 + "]" * 17, ["more than 16 levels"]),
        ("[" * 16 + "]" * 16, ["expected: a mapping"]),
        ("".join("  " * i + "a:\n" for i in range(300)), ["more than 16 levels"]),
        ("#" * 300_000, ["longer than 250,000 bytes"]),
        ("", ["is empty", "expected: a mapping with keys among name, points, rig, oscillator"]),
        ("points: {omega: [1]}\noscillator: 3\n", ["oscillator = 3", "a mapping with keys among"]),
    ],
)  # fmt: skip
def test_what_is_not_a_mapping_in_yaml(text, parts):
    message = refusal(text)
    assert "sweep.yaml" in message
    for part in parts:
        assert part in message


@pytest.mark.parametrize("text", ["a: [1\n", "a: b: c\n", "name: 'a\tb\n"])
def test_other_faults_of_yaml_do_not_speak_of_tabs(text):
    message = refusal(text)
    assert "not valid YAML" in message and "spaces" not in message


@pytest.mark.parametrize("name", ["folder", "binary.yaml", "a\0b"])
def test_a_file_that_cannot_be_read(tmp_path, name):
    (tmp_path / "folder").mkdir()
    (tmp_path / "binary.yaml").write_bytes(b"h: \xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"cannot be read .*expected: a YAML file"):
        load_config(tmp_path / name)
    with pytest.raises(ConfigError, match=r"missing\.yaml does not exist$"):
        load_config(tmp_path / "missing.yaml")
