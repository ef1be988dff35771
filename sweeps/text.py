"""Words of any message: numbers, ranges ``low .. high``, tables, commands, progress."""

from __future__ import annotations

import math
import os
import re
import shlex
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vibroimpact.inputs import near_misses, suggestion
from vibroimpact.inputs import shortened as shortened  # for messages here, too
from vibroimpact.inputs import shown_count as shown_count

#: A length or a time for which no name was chosen, in a unit.
UNNAMED = re.compile(r"\b(length|time)\b")


def missing_text(path: Path) -> str:
    """Say that a file does not exist, with the most similar name of a file of its kind there."""
    try:
        names = {name.removesuffix(".parts") for name in os.listdir(path.parent)}
    except OSError:
        names = set()
    kinds = (".csv",) if path.suffix == ".csv" else (".h5", ".yaml", ".yml")
    others = [name for name in sorted(names - {path.name}) if name.endswith(kinds)]
    meant = suggestion([str(path.with_name(n)) for n in near_misses(path.name, others, 0.8)])
    return f"{path} does not exist{meant}{of_shell(path)}".replace("\n", r"\n")  # one line


def of_shell(path: Path) -> str:
    """Return a hint at what only a shell replaces in a path that is missing: ~, $HOME, ${HOME}."""
    typed = re.search(r"(?<![^/\\])~\w*(?=[/\\]|$)|\$\w+|\$\{\w+\}|%\w+%", str(path))
    return f"; only a shell replaces {typed[0]}" if typed else ""


def command(*words: str | Path) -> str:
    """Write a command of the program for a shell: a path that begins with - is not an option."""
    typed = (f"./{w}" if isinstance(w, Path) and str(w)[0] == "-" else w for w in words)
    return " ".join(["vibroimpact", *(_quoted(str(word)) for word in typed)])


def _quoted(word: str) -> str:
    """Quote a word for a shell; bash reads unprintable characters from their bytes."""
    if word.isprintable():
        return shlex.quote(word)
    plain = {c for c in word if c.isprintable() and c not in "'\\"}
    parts = (c if c in plain else "".join(map("\\x{:02x}".format, os.fsencode(c))) for c in word)
    return f"$'{''.join(parts)}'"


def printable(text: str) -> str:
    """Escape all except printable characters and newlines: a terminal would obey or hide them."""
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


def table(rows: Sequence[Sequence[str]], words: int | None = None) -> str:
    """Align the columns of rows of equal length, separated by two spaces.

    The first `words` columns are aligned left and the others right. By default all are left.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    of_words = len(widths) if words is None else words
    aligned = [str.ljust] * of_words + [str.rjust] * (len(widths) - of_words)
    lines = (
        [align(cell, width) for align, cell, width in zip(aligned, row, widths, strict=True)]
        for row in rows
    )
    return "\n".join("  ".join(line).rstrip() for line in lines)


def fewest_digits(value: float) -> str:
    """Write a number with the fewest digits that identify it: 7, not 7.0."""
    return repr(float(value)).removesuffix(".0")


def told_apart(*values: float) -> list[str]:
    """Write numbers with six digits, or with as many as different numbers need to differ."""
    texts: list[str] = []
    for digits in range(6, 18):
        texts = [f"{value:.{digits}g}" for value in values]
        if len(set(texts)) == len(set(values)):
            break
    return texts


def in_units(unit: str, units: Mapping[str, str]) -> str:
    """Replace length and time in a unit by the units chosen for them: mm/s^2 for length/time^2."""
    return UNNAMED.sub(lambda match: units.get(match[0], match[0]), unit)


def unit_name(unit: str) -> str:
    """Return a unit if a name was chosen for it, as mm/s, and not for rad, 1 or length/time."""
    return "" if unit in ("1", "rad") or UNNAMED.search(unit) else unit


def in_brackets(unit: str) -> str:
    """Write a unit after a name: [mm/s] after a space, or nothing for a pure number."""
    return "" if unit in ("", "1") else f" [{unit}]"


def shown_range(values: Sequence[float | str]) -> str:
    """Write the range of values, for example 0.5 .. 0.9; if they are words, list each one."""
    if any(isinstance(value, str) for value in values):
        return ", ".join(sorted({str(value) for value in values}))
    low, high = min(map(float, values)), max(map(float, values))
    if low == high:
        return f"{low:.6g}"
    digits = 6  # more if needed to resolve a hundredth of the range
    while digits < 17 and abs(high - low) < 10.0 ** (2 - digits) * max(abs(low), abs(high)):
        digits += 1
    return f"{low:.{digits}g} .. {high:.{digits}g}"


def shown_bytes(size: float) -> str:
    """Write a size given in bytes with a suitable unit, for example 1.2 GB."""
    units = ["B", "kB", "MB", "GB", "TB"]
    while size >= 999.5 and len(units) > 1:
        size /= 1000.0
        del units[0]
    return f"{three_digits(size)} {units[0]}"


def shown_duration(seconds: float) -> str:
    """Write a duration given in seconds with a suitable unit; "unknown" for NaN."""
    if math.isnan(seconds):
        return "unknown"
    for limit, unit, size in ((90, "s", 1), (5400, "min", 60), (172800, "h", 3600)):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{three_digits(seconds / 86400)} days"


def three_digits(value: float) -> str:
    """Write three digits of a number, and all of its integer part: 1,234, not 1.23e+03."""
    return f"{value:.3g}" if value < 999.5 else f"{value:,.0f}"


def listed(names: Iterable[str]) -> str:
    """Join names with commas."""
    return ", ".join(names)


def choice_of(names: Collection[str], noun: str = "axis") -> str:
    """Write the allowed names for the message of a refusal."""
    return f"choose from: {listed(names)}" if names else f"there is no {noun} to choose from"


#: Time after which work says what it is [s].
PATIENCE = 2.0


@contextmanager
def progress_shown(work: str, quiet: bool = False) -> Iterator[Callable[[float], None]]:
    """Say on stderr what work takes long and what is compiled, and on a terminal how far it is.

    Call the result with the share that is done.
    """
    from rich.console import Console
    from rich.text import Text

    from vibroimpact.jit import watched

    console = Console(stderr=True, quiet=quiet, soft_wrap=True)
    status, begin, done = console.status(""), time.perf_counter(), threading.Event()
    state: dict[str, Any] = {"share": 0.0, "compiling": ""}
    lines_shown = {""}

    def show(line: str, **new: Any) -> None:  # the line is that of a log
        state.update(new)
        share, seconds = state["share"], time.perf_counter() - begin
        text = state["compiling"] or f"{work}: {shown_duration(seconds)}"
        if not state["compiling"] and 0.02 < share < 1.0:
            remaining = shown_duration(seconds * (1.0 - share) / share)
            text += f", {100.0 * share:.0f} %, about {remaining} left"
        if console.is_terminal and not quiet:
            status.update(Text(printable(text)))
            status.start()
        elif line not in lines_shown:
            lines_shown.add(line)
            console.print(Text(printable(line)))

    def wait() -> None:
        pause = PATIENCE
        while not done.wait(pause):
            if not state["compiling"]:  # which is said
                show(f"{work} ...")
            pause = 1.0

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    try:
        with watched(lambda text, _: show(text, compiling=text)):
            yield lambda share: show("", share=share)
    finally:
        done.set()
        waiting.join()
        status.stop()
