"""Whatever is given as a configuration, it is run or refused in words, and leaves no trace."""

from pathlib import Path

import h5py
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import sweeps
from sweeps.cli.main import app
from sweeps.config.loading import load_config
from sweeps.errors import ConfigError, StoreError
from sweeps.store.reader import open_sweep

CONFIGS = Path(sweeps.__file__).parents[1] / "configs"
FULL = """\
name: all
oscillator:
  h: 0.1
  R: [0.5, 0.8]
  omega: {start: 0.8, stop: 4.0, num: 16, spacing: log}
  f: 1.0
  p: 1.0
  clearance: 0.1
start: {x0: 0.0, v0: [0.0, 1.0]}
method: {integrator: exact, impact: exact, steps_per_period: 64}
record: {transient: 5, periods: 5, phase: 1.0, impacts: 6, trajectory: {every: 4}}
compression: gzip
output: x.h5
"""
BASES = [FULL, *(path.read_text() for path in sorted(CONFIGS.glob("*.yaml")))]
ODD = """
1e308 -1e308 -0.0 0 5e-324 1e-300 1e999 nan .inf -.inf 1e9 1e18 99999999999999999999 true null ~ ''
[] {} [[]] [1,1,1] {start:0,stop:1,num:1e7} {start:1e-320,stop:1e308,num:3,spacing:log}
{start:-1e308,stop:1e308,num:2} &a *a !!python/object/apply:os.system !!binary "a\\0b" 'a/b'
/etc/passwd ../../x 0x10 010 1:30 1_000 . 0.5 4 64 1e5 gzip rk4 plain euler x.png {a:{b:{c:{}}}}
""".split()
settings.register_profile(
    "fuzz",
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def leaves(tree, path=()):
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, (dict, list)):
            yield from leaves(value, (*path, key))


@st.composite
def mutated(draw):
    """A valid configuration with one to three values replaced, keys renamed or lost."""
    tree = yaml.load(draw(st.sampled_from(BASES)), Loader=yaml.BaseLoader)
    odd = []
    for _ in range(draw(st.integers(1, 3))):
        *path, last = draw(st.sampled_from(sorted(leaves(tree), key=str) or [("h",)]))
        section = tree
        for key in path:
            section = section[key]
        change = draw(st.sampled_from(["odd", "odd", "odd", "lose", "rename"]))
        if change == "odd":
            section[last] = f"<{len(odd)}>"
            odd.append(draw(st.sampled_from(ODD) | st.floats().map(repr) | st.text(max_size=8)))
        elif change == "rename" and isinstance(section, dict):
            section[draw(st.sampled_from(["omga", "num", "x0", "", "a" * 99]))] = section.pop(last)
        else:
            del section[last]
    text = yaml.safe_dump(tree, default_flow_style=draw(st.sampled_from([None, True])))
    for number, value in enumerate(odd):
        text = text.replace(f"<{number}>", value)
    return text


def answered(text):
    """Run a configuration dry, and return the exit code."""
    Path("fuzz.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
    result = CliRunner().invoke(app, ["run", "fuzz.yaml", "--dry-run"])
    assert result.exit_code in (0, 2), result.output
    assert isinstance(result.exception, (SystemExit, type(None)))
    assert "Traceback" not in result.output
    assert result.exit_code == 0 or result.stderr.startswith("vibroimpact: error: ")
    assert [path.name for path in Path().iterdir()] == ["fuzz.yaml"]
    return result.exit_code


@settings(settings.get_profile("fuzz"), max_examples=400)
@given(text=mutated())
def test_a_mutated_configuration_is_answered(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    answered(text)


@settings(settings.get_profile("fuzz"), max_examples=200)
@given(text=st.text(max_size=200) | st.text("{}[]:,#&*!|>-'\" \n\th1e", max_size=200))
def test_any_text_is_answered(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    assert answered(text) == 2


@pytest.mark.parametrize("base", BASES)
def test_the_bases_are_valid(tmp_path, monkeypatch, base):
    monkeypatch.chdir(tmp_path)
    assert answered(base) == 0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[" * 100_000, "more than 16 levels"),
        ("a: " * 30, "not valid YAML"),
        ("".join("  " * i + "a:\n" for i in range(300)), "more than 16 levels"),
        ("#" * 300_000, "longer than 250,000 bytes"),
        ("a: &a [x, x]\nb: [*a, *a]\n", "aliases and tags are not allowed"),
        ("a: !!python/object/apply:os.system [ls]\n", "aliases and tags are not allowed"),
        (FULL.replace("x.h5", '"a\\0b.h5"'), "embedded null byte"),
        (FULL.replace("x.h5", "x" * 300), "File name too long"),
    ],
)
def test_what_is_out_of_bounds_is_refused(tmp_path, monkeypatch, text, told):
    monkeypatch.chdir(tmp_path)
    Path("fuzz.yaml").write_text(text)
    for options in (["--dry-run"], []):
        result = CliRunner().invoke(app, ["run", "fuzz.yaml", *options])
        assert result.exit_code == 2 and told in result.stderr
    assert [path.name for path in Path().iterdir()] == ["fuzz.yaml"]


def test_a_device_is_no_configuration():
    with pytest.raises(ConfigError, match="longer than"):
        load_config("/dev/zero")


@pytest.mark.parametrize("where", ["/dev/null", "/dev/zero", "/etc/passwd", "/", "a\0b", "x" * 300])
def test_what_is_no_file_of_a_sweep_is_refused(where):
    with pytest.raises(StoreError):
        open_sweep(where)


@settings(settings.get_profile("fuzz"), max_examples=50)
@given(data=st.binary(max_size=500), start=st.sampled_from([b"", b"\x89HDF\r\n\x1a\n", b"CDF\x01"]))
def test_any_bytes_are_no_file_of_a_sweep(tmp_path, data, start):
    path = tmp_path / "out.h5"
    path.write_bytes(start + data + b"\x89VIBROL\n")
    with pytest.raises(StoreError, match=r"out\.h5"):
        open_sweep(path)


def test_an_hdf5_file_from_elsewhere_is_refused(tmp_path):
    path = tmp_path / "out.h5"
    with h5py.File(path, "w") as file:
        file["x"] = range(5)
        file.attrs["format"] = h5py.Empty("f")
    with pytest.raises(StoreError, match="not one that vibroimpact wrote"):
        open_sweep(path)
