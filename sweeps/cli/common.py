"""Options that commands share, as ``--at``; the scenes; notes and errors on a terminal."""

from __future__ import annotations

import io
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import typer

from sweeps.errors import Refused
from sweeps.text import command, near_misses, printable, shortened, suggestion, told_apart
from vibroimpact.inputs import Allowed, integer, is_number, number_meant, refusal

if TYPE_CHECKING:
    import xarray as xr

    from sweeps.opened.opened_sweep import OpenedSweep, Selection

#: Gives the names that a shell completes.
Completions = Callable[[], Iterable[str]]


def argument(metavar: str, help: str, default: Any = ..., names: Completions | None = None) -> Any:
    """Return an argument of a command; a shell completes the names."""
    return typer.Argument(default, metavar=metavar, help=help, autocompletion=_completion(names))


def option(
    metavar: str, help: str, *called: str, names: Completions | None = None, **settings: Any
) -> Any:
    """Return an option of a command, called as its parameter or so; a shell completes the names."""
    settings = {"default": None, "autocompletion": _completion(names)} | settings
    return typer.Option(settings.pop("default"), *called, metavar=metavar, help=help, **settings)


def flag(called: str, help: str) -> Any:
    """Return an option without a value."""
    return typer.Option(False, called, help=help)


def numeric(
    called: str, allowed: Allowed, help: str, metavar: str = "N", default: float | None = None
) -> Any:
    """Return an option for a number, which refuses all but allowed ones."""
    return option(metavar, help, called, parser=number_option(called, allowed), default=default)


def number_option(called: str, allowed: Allowed) -> Callable[[object], Any]:
    """Return a function that reads the number of an option, and refuses all but allowed ones."""

    def read(value: object) -> int | float | None:
        number = number_meant(str(value))
        if not allowed.fits(number):
            raise Refused(refusal(f"{called} {value}", allowed.expected))
        return number

    return read


def new_file(called: str, ending: str, what: str, help: str, *others: str, **settings: Any) -> Any:
    """Return an option for a file to write, which refuses a path where it cannot be written."""

    def check(path: Path | None) -> Path | None:
        if path is not None:
            from sweeps.store.replacing import check_target

            if path.suffix != ending:
                raise Refused(refusal(f"{called} {path}", f"a {ending} file"))
            check_target(path, what)
        return path

    return option("FILE", help, called, *others, callback=check, **settings)


def scenes(ending: str = ".yaml") -> Mapping[str, str]:
    """Return the text of every scene by its name; with ``.csv``, the tables that scenes have."""
    folder = Path(__file__).parents[1] / "scenes"
    if not folder.is_dir():  # in a checkout
        folder = Path(__file__).parents[2] / "configs"
    return {path.stem: path.read_text("utf-8") for path in sorted(folder.glob(f"*{ending}"))}


def _completion(names: Completions | None) -> Callable[[str], list[str]] | None:
    """Return a function with which a shell completes the beginning of a name."""
    return names and (lambda incomplete: [n for n in names() if n.startswith(incomplete)])


def read_threads(value: object) -> int:
    """Read a number of threads that numba allows."""
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    threads: int = number_option("--threads", integer(1, cores))(value)
    return threads


THREADS = option("N", "Threads to use; all cores if not given.", parser=read_threads)
RESUME = flag("--resume", "Compute only the missing points of the output.")
OVERWRITE = flag("--overwrite", "Replace the output.")
SWEEP_FILE = argument("OUT.h5", "The file of a sweep.")
OF_CLASSES = option("M/Q,...", "Only exact branches or curves of these classes, e.g. 1/1,3/3.")
MOST_FOLLOWED = numeric("--most", integer(1), "Follow at most N exact branches.")
CUT_AT = option(
    "NAME=VALUE",
    "Value at which a swept parameter is cut, or direction=up or down for a sweep that was "
    "followed both ways; repeatable.",
    default=[],
)
CSV = new_file("--csv", ".csv", "table", "Write the numbers to a .csv file, too.")
JSON = flag("--json", "Write JSON, for other programs, instead of text.")

#: The limits of an axis, in words.
LIMITS = "LOW:HIGH, two numbers of which the first is smaller"
#: Most characters in the name of a file of what is asked for.
_MOST_CHARACTERS = 100
_PER_INCH = {"in": 1.0, "cm": 2.54, "mm": 25.4, "pt": 72.0}


def exact_options(
    classes: str | None, most: int | None, kinds: str | None = None
) -> dict[str, Any]:
    """Convert the choice of exact orbits to arguments of `sweeps.branches` or `sweeps.curves`."""
    chosen: dict[str, Any] = {}
    if classes is not None:
        pairs = [
            re.fullmatch(r"\s*([1-9]\d{,8})/(\d{1,9})\s*", text) for text in classes.split(",")
        ]
        if not all(pairs):
            expected = "periods/impacts of one class or several, as 1/1,3/3"
            raise Refused(refusal(f"--classes {classes}", expected))
        chosen["classes"] = [(int(pair[1]), int(pair[2])) for pair in pairs if pair]
    if most is not None:
        chosen["most"] = most
    if kinds is not None:
        chosen["kinds"] = at_commas(kinds)
    return chosen


def at_commas(text: str) -> list[str]:
    """Split a text at its commas."""
    return re.split(r"\s*,\s*", text.strip())


def inches(option: str, text: str | None) -> float | None:
    """Convert a length with its unit to inches; None if none is given."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*([0-9]+\.?[0-9]*|\.[0-9]+)\s*(in|cm|mm|pt)\s*", text)
    length = float(match[1]) / _PER_INCH[match[2]] if match else math.nan
    if not 1.0 <= length <= 40.0:
        expected = "a length from 1in to 40in, as 3.4in, 8.6cm, 86mm or 245pt"
        raise Refused(refusal(f"{option} {text}", expected))
    return length


def interval(text: str) -> tuple[float, float] | None:
    """Read LOW:HIGH; return None unless both are finite and LOW is smaller."""
    low, high = (number_meant(end) for end in text.partition(":")[::2])
    if low is None or high is None or not low < high:
        return None
    return (float(low), float(high)) if math.isfinite(high - low) else None


def limits_option(axis: str, text: str | None) -> dict[str, Any]:
    """Convert the limits of axis x or y, if given, to arguments of a `Page`."""
    if text is None:
        return {}
    match = re.fullmatch(r"(.*[0-9.])\s*([^\W0-9_]+(?:/s)?)", text)
    number, unit = match.groups() if match else (text, "")
    limits = interval(number)
    if limits is None:
        raise Refused(refusal(f"--{axis}lim {text}", f"{LIMITS}, as 2.4:3"))
    return {f"{axis}lim": limits, f"{axis}unit": unit}


def resuming() -> str:
    """Return the command that resumes the run of this command."""
    words = [word for word in sys.argv[1:] if word not in ("--overwrite", "--resume")]
    words.insert(words.index("--") if "--" in words else len(words), "--resume")
    return command(*words)


def targets(sources: Sequence[Path], output: Path | None, defaults: Sequence[Path]) -> list[Path]:
    """Return the output for each source: its default, or `output` for a single source."""
    if output is None:
        targets = list(defaults)
    elif len(sources) == 1:
        targets = [output]
    else:
        raise Refused(
            f"-o {output} is not allowed here: it is for a single file, and {len(sources)} are "
            "given; without it each has an output of its own"
        )
    first: dict[str, Path] = {}
    for source, target in zip(sources, targets, strict=True):
        real = os.path.realpath(str(target).replace("\0", ""))  # which no file has: refused later
        writer = first.setdefault(real, source)
        if writer is not source:
            raise Refused(f"{writer} and {source} would both write {target}; give them one by one")
    return targets


def name_after(stem: str, words: Iterable[str], ending: str) -> str:
    """Name a file, valid on every system, after what is asked for or, if long, its checksum."""
    text = re.sub(r"[^\w.+-]+", "_", "-".join(words)).rstrip("._")
    if len(text) > _MOST_CHARACTERS:
        text = f"{crc32(text.encode()):08x}"
    return f"{stem}{'-' * bool(text)}{text}{ending}"


def selection_of(texts: Sequence[str]) -> dict[str, float | str]:
    """Read the values of ``--at``, at most one for each axis."""
    return several_of(texts, 1)[0]


def several_of(
    texts: Sequence[str], most: float = math.inf
) -> tuple[dict[str, float | str], dict[str, list[float]]]:
    """Read the values of ``--at``: of the axes with one value, and lists of those with several."""
    single, lists = dict[str, float | str](), dict[str, list[float]]()
    for text in texts:
        name, _, typed = map(str.strip, text.partition("="))
        numbers = [number_meant(value) for value in typed.split(",")]
        if name != "direction" and not (all(map(is_number, numbers)) and len(numbers) <= most):
            example = "omega=2.5,2.7" if most > 1 else "omega=2.5"
            raise Refused(refusal(f"--at {text}", f"NAME=VALUE without a unit, as {example}"))
        if name in single or name in lists:
            together = "; give its values in one list" * (most > 1)
            raise Refused(f"--at {text} is not allowed; {name} was given before{together}")
        values = [float(number or 0.0) for number in numbers]
        if name == "direction" or len(values) == 1:
            single[name] = typed if name == "direction" else values[0]
        else:
            lists[name] = values
    return single, lists


@contextmanager
def opened_in_si(file: Path, *, verify: bool = True) -> Iterator[OpenedSweep]:
    """Open the file of a sweep, that of a rig in SI units; close it at the end of the block."""
    from sweeps.opened.doors import in_si
    from sweeps.opened.opened_sweep import OpenedSweep

    with opened_sweep(file, verify=verify) as dataset:
        with named(file):
            sweep = in_si(OpenedSweep(dataset))
        yield sweep


def opened_sweep(file: Path, *, verify: bool = True) -> xr.Dataset:
    """Open the file of a sweep; if it is none, say what the configuration of its name writes."""
    from sweeps.errors import StoreError
    from sweeps.store.xarray_engine import open_sweep

    try:
        return open_sweep(file, verify=verify)
    except StoreError as error:
        hint = _written_instead(file)
        raise StoreError(f"{error}{hint}") if hint else error from None


def _written_instead(file: Path) -> str:
    """Return a hint at the output of the configuration with the name of a file that is no sweep."""
    from sweeps.config.loading import load_config
    from sweeps.errors import ConfigError
    from sweeps.store.paths import is_sweep

    endings = () if os.path.isdir(file) or is_sweep(file) else (".yaml", ".yml")
    for config in (file.with_suffix(ending) for ending in endings):
        if os.path.isfile(config):  # False also for too long a name
            with suppress(ConfigError):
                output = load_config(config).output
                if is_sweep(output):
                    return f"; the output of {config} is {output}"
                return f"; to compute it: {command('run', config)}"
    return ""


@contextmanager
def named(source: object) -> Iterator[None]:
    """Prefix each refusal raised in the block with the name of its file or option."""
    try:
        yield
    except Refused as error:
        raise Refused(f"{source}: {error}") from error


def save_table(csv: Path | None, table: Any, *, error: bool = False) -> None:
    """Write a table to a CSV file, if one is given, and say its name."""
    if csv is not None:
        from sweeps.opened.export import write_csv

        write_csv(csv, [table])
        say(csv, error=error)


def say_moved(sweep: OpenedSweep, requested: Selection, verb: str) -> None:
    """Report each requested value that is not on the grid, and the value used instead."""
    cut = sweep.isel(sweep.indices(requested))
    for name, value in requested.items():
        used = cut[name].item()
        if isinstance(value, float) and abs(value - used) > sweep.slack(name):
            text, grid_value = told_apart(value, used)
            say(f"{name} = {text} is not on the grid; {verb} at {name} = {grid_value}", error=True)


def unreadable(error: Any) -> str:
    """Return the message of arguments that typer cannot read, with the command that explains."""
    if hasattr(error, "possibilities"):  # by their names, as all begin alike
        options = [name for each in error.ctx.command.get_params(error.ctx) for name in each.opts]
        names = {name.lstrip("-"): name for name in options if name.startswith("-")}
        meant = [names[name] for name in near_misses(error.option_name.lstrip("-"), names)]
        text = f"there is no option {error.option_name}{suggestion(meant)}"
    else:
        text = error.format_message().rstrip(".")
        text = text[0].lower() + text[1:]
    return f"{shortened(text, 200)}; {error.ctx.command_path} --help shows what is allowed"


# Output to a terminal: a warning takes one line, and control characters are escaped


def say(text: object, *, error: bool = False, end: bool = True) -> None:
    """Write a text to stdout, or stderr for an error, with control characters escaped."""
    typer.echo(printable(str(text)), err=error, nl=end)


def prepare_streams() -> None:
    """Escape characters that the encoding lacks, and show Python warnings on one line."""
    # Libraries write to the numbers of closed streams, so that no file must get them.
    while (free := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(free)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    warnings.showwarning = lambda message, *_: say(f"vibroimpact: warning: {message}", error=True)
