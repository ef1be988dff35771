"""Commands in other environments: start-up, odd settings, names and streams."""

import errno
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from sweeps import Refused, explore, open_sweep, run_sweep
from sweeps.cli.__main__ import _reason
from sweeps.text import printable
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.interruptions import environment
from tests.helpers.places import ROOT

pytestmark = pytest.mark.slow

CONFIG = SMALL


def process(*arguments, **variables):
    """Run the command line in a separate process with environment variables."""
    command = [sys.executable, "-m", "sweeps.cli", *arguments]
    variables = {**environment(), **variables}
    return subprocess.run(command, capture_output=True, text=True, env=variables, timeout=300)


def test_closed_streams(small_file):
    """No file is opened under their numbers, and what is told on them is not missed."""
    code = (
        "import os, sys; from sweeps.cli.common import prepare_streams; prepare_streams()\n"
        "number = os.open('small.h5', os.O_RDONLY); sys.stdout.write('lost')\n"
        "sys.stderr.write('lost')\n"
        "sys.exit(number < 3 or not all(os.fstat(i) for i in range(3)))"
    )
    how = {"shell": True, "check": True, "env": environment(), "timeout": 300}
    for closed in ("2>&-", ">&- 2>&- <&-"):
        subprocess.run(f'{sys.executable} -c "{code}" {closed}', **how)
    subprocess.run(f"{sys.executable} -m sweeps.cli export small.h5 -o a.csv {closed}", **how)
    assert Path("a.csv").read_text().startswith("omega,clearance,")


def test_version():
    assert accepted("--version").startswith("vibroimpact")


def python(code, **variables):
    options = {"env": {"PYTHONPATH": str(ROOT), **variables}, "capture_output": True, "text": True}
    return subprocess.run([sys.executable, "-c", code], **options, timeout=300)


def imported(commands):
    """Return the modules imported up to the end of each command in a process, and its exit code."""
    code = (
        "import sys\n"
        "from sweeps.cli.__main__ import main\n"
        f"for words in {[command.split() for command in commands]}:\n"
        "    sys.argv, code = ['vibroimpact', *words], 0\n"
        "    try:\n"
        "        main()\n"
        "    except SystemExit as end:\n"
        "        code = end.code or 0\n"
        "    names = (name for name, module in sys.modules.items() if module)\n"
        "    print('\\f', code, *names, '\\f')\n"
    )
    result = python(code)
    assert result.returncode == 0, result.stderr
    return [{*words.split()} for words in result.stdout.split("\f")[1::2]]


#: What takes long to import: the compiler, what xarray looks for, and what pictures need.
COMPILER = {"numba", "llvmlite", "vibroimpact.jit.compiling"}
XARRAY = {"xarray", "pandas", "dask"}
PICTURES = {"matplotlib", "PIL"}
ALL = COMPILER | XARRAY | PICTURES | {"numpy", "scipy", "h5py", "yaml"}


RUN = "run sweep.yaml -o a.h5"


@pytest.mark.parametrize(
    "commands",
    [
        {
            "--help": ALL | {"pydantic"},
            # Newer typers import pydantic to describe the arguments of a command.
            "run --help": ALL,
            "bench stability --help": ALL,
            f"{RUN} --set oscillator.R=2": COMPILER | XARRAY | PICTURES,
            f"{RUN} --dask host:1": COMPILER | XARRAY | PICTURES,
            f"{RUN} --dry-run": XARRAY | PICTURES,
        },
        {
            "info small.h5": COMPILER | PICTURES | {"dask", "scipy"},
            "plot small.h5 --kind map": COMPILER | {"dask"},
        },
    ],
)
def test_a_command_imports_nothing_heavy_that_it_does_not_need(small_file, commands):
    for command, words in zip(commands, imported(commands), strict=True):
        assert ("2" if "R=2" in command or "--dask" in command else "0") in words, command
        assert commands[command] & words == set(), command


def test_what_a_file_says_reaches_the_terminal_escaped():
    odd = '"a\\x9b31m\\u202E.h5"'
    message = refused("run", "sweep.yaml", "--set", f"output={odd}", "--set", "name=nowhere/x")
    assert message.isascii() and printable(message) == message
    printed = accepted("run", "sweep.yaml", "--set", f"output={odd}", "--dry-run")
    assert r"a\x9b31m\u202e.h5" in printed and printable(printed) == printed
    result = call("run", "sweep.yaml", "--set", f"output={odd}", "--set", "name=a[red]\u202eb")
    assert result.exit_code == 0
    assert printable(result.stdout) == result.stdout and r"\u202e.h5" in result.stdout
    for text in (result.stderr, accepted("info", next(Path().glob("*.h5")))):
        assert r"a[red]\u202eb" in text and "\u202e" not in text
    bad = refused("run", "sweep.yaml", "--set", 'oscillator.h="\\e[31m"')
    assert r"oscillator.h = \x1b[31m is not a number" in bad and "\x1b" not in bad
    assert r"\x1b[31m.h5 does not exist" in refused("info", "\x1b[31m.h5")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow Unicode alone")
def test_names_of_files_that_are_not_utf_8(small_file, unpainted):
    data, picture = (os.fsdecode(name) for name in (b"a\xff.h5", b"p\xff.png"))
    Path("small.h5").rename(data)
    assert accepted("plot", data, "-o", picture) == "p\\udcff.png\n"
    assert accepted("zoom", data, "omega=2:2.1")
    assert Path(os.fsdecode(b"a\xff-omega-2-2.1.png")).stat().st_size
    assert "exists; resume it, overwrite it" in refused("run", data)  # it is its own output


def test_a_picture_with_a_long_name(small_file, unpainted):
    assert accepted("plot", "small.h5", "-o", "a" * 251 + ".png")
    assert "File name too long" in refused("plot", "small.h5", "-o", "a" * 252 + ".png")
    result = call("plot", "small.h5", "-o", "/proc/x.png")
    assert result.exit_code == 1
    assert re.fullmatch(r"vibroimpact: error: /proc/x.png cannot be written: .*\n", result.stderr)
    assert not list(Path().glob(".*"))


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("NUMBA_NUM_THREADS=abc", "could not be parsed"),
        ("NUMBA_DISABLE_JIT=1", "needs numba's compiler"),
    ],
)
def test_odd_settings_of_numba_are_refused(setting, told):
    name, value = setting.split("=")
    result = process("run", "sweep.yaml", **{name: value})
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith("vibroimpact: error: numba cannot work with its settings: ")
    assert told in result.stderr and setting in result.stderr and result.stderr.count("\n") == 1


def test_a_compiler_that_cannot_be_loaded_is_not_blamed_on_the_settings():
    """As with too little memory (ulimit -v): llvmlite then finds no library."""
    path = os.pathsep.join([os.getcwd(), environment()["PYTHONPATH"]])
    lacking = "raise OSError('Could not find/load shared object file')"
    Path("llvmlite").mkdir()
    Path("llvmlite/__init__.py").write_text(lacking)
    result = process("run", "sweep.yaml", NUMBA_CACHE_DIR="cache", PYTHONPATH=path)
    assert (result.returncode, result.stdout) == (1, "")
    assert "the compiler numba cannot be loaded, perhaps for lack of memory" in result.stderr
    assert "Could not find/load" in result.stderr and "NUMBA_CACHE_DIR" not in result.stderr
    result = process("run", "sweep.yaml", PYTHONPATH=path)
    assert result.stderr == "vibroimpact: error: Could not find/load shared object file\n"


def test_odd_settings_of_matplotlib_are_refused(small_file):
    result = process("plot", "small.h5", MPLBACKEND="nonsense")
    assert result.returncode == 2 and not Path("small.png").exists()
    assert "matplotlib cannot work with its settings: " in result.stderr
    assert "unset or correct MPLBACKEND" in result.stderr and result.stderr.count("\n") == 1


def test_a_bad_line_of_matplotlib_is_told_once_and_unusable_settings_are_refused(small_file):
    Path("matplotlibrc").write_text("font.size: large")
    result = process("plot", "small.h5", "-o", "b.svg")
    assert result.returncode == 0 and Path("b.svg").stat().st_size
    assert result.stderr.count("Bad value in file") == 1
    for unusable in ({"text.usetex": True}, {"figure.dpi": 1.0}):
        with mpl.rc_context(unusable):
            message = refused("plot", "small.h5", "-o", "a.svg")
        assert "matplotlib cannot draw with the settings in matplotlibrc" in message
        assert message.count("\n") == 1
    with mpl.rc_context({"savefig.dpi": 1e9}):
        message = refused("plot", "small.h5", "-o", "a.png")
    assert "pixels is too large; expected: less than 16384 each way" in message
    assert not list(Path().glob("a.*"))


def test_a_folder_that_was_removed_is_named():
    Path("folder").mkdir()
    os.chdir("folder")
    Path("../folder").rmdir()
    result = call("info", "small.h5")
    assert result.exit_code == 2
    assert result.stderr.startswith("vibroimpact: error: the working folder was removed")
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0}}
    for function, *given in ((run_sweep, scene, "a.h5"), (open_sweep, "a.h5"), (explore, scene)):
        with pytest.raises(Refused, match="the working folder was removed; change to one that"):
            function(*given)


def test_a_zip_says_that_it_must_be_unpacked():
    """Compiled code is named after the files of its sources."""
    for package in ("vibroimpact", "sweeps"):
        shutil.copytree(ROOT / package, f"both/{package}", ignore=lambda *_: ["__pycache__"])
    path = shutil.make_archive("both", "zip", "both")
    result = process("info", "small.h5", PYTHONPATH=path)
    assert result.returncode == 1 and result.stderr.count("\n") == 1
    code = f"""
import sys
sys.path.insert(0, {path!r})
for what in ("vibroimpact", "sweeps.plotting", "sweeps.store", "sweeps; sweeps.run_sweep"):
    try:
        exec(f"import {{what}}")
    except ImportError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    told = done.stdout.splitlines()
    assert len(told) == 4
    assert all(text.startswith(f"{path} is no folder: ") and "unpack it" in text for text in told)


def test_a_warning_is_one_line_and_a_character_that_the_encoding_lacks_is_escaped():
    code = (
        "import warnings\n"
        "from sweeps.cli.common import prepare_streams\n"
        "prepare_streams()\n"
        "warnings.warn('the cache\\x1b[31m is full')\n"
        "warnings.showwarning(message='so is the disk')\n"
        "print('\u65e5')\n"
    )
    done = python(code, PYTHONIOENCODING="latin-1")
    warned = ["the cache\\x1b[31m is full", "so is the disk"]
    assert done.stderr == "".join(f"vibroimpact: warning: {text}\n" for text in warned)
    assert done.stdout == "\\u65e5\n"


def test_an_error_of_a_file_without_a_name_does_not_blame_the_standard_output():
    said = "a file cannot be read or written: Stale file handle"
    assert _reason(OSError(errno.ESTALE, "Stale file handle")) == said
