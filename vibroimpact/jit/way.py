"""Chooses which parts of numba are used: private ones, options, or the plainest, after a trial.

The faster ways change no result, but a version of numba may lack what they need. With a version
that was not tried, each is checked once per installation, in a process of its own that may crash.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import warnings
from contextlib import suppress
from typing import NamedTuple

import llvmlite.binding
import numba

from vibroimpact.jit.cache import NUMERICS, read, root, write

#: The versions of numba that were tried, each with ``.ci/numba_versions.py``.
TRIED = ("0.60", "0.61", "0.62", "0.63", "0.64", "0.65", "0.66", "0.67", "0.68")

#: The ways, the fastest first.
WAYS = {
    "private": "with its private parts, at full speed",
    "options": "with options alone, at about nine tenths of the speed",
    "plain": "in its plainest way, at about half of the speed",
}
#: The name of a way in this variable takes it without a check; ``0`` is the plainest.
_VARIABLE = "VIBROIMPACT_NUMBA_HOOKS"
_SECONDS = 300  # for a process of the check, which takes 2 s


class Way(NamedTuple):
    """A way of `WAYS`, and why it was taken."""

    name: str
    reason: str

    def __str__(self) -> str:
        return f"{WAYS[self.name]} ({self.reason})"


class NumbaWarning(UserWarning):
    """A version of numba was not tried; the text is one line for the user."""


def _chosen() -> Way:
    """Return the way of this process."""
    name = os.environ.get(_VARIABLE, "")
    name = "plain" if name == "0" else name
    lacking = "" if name in ("options", "plain") else _lacking()
    if name in WAYS and not lacking:
        return Way(name, f"{_VARIABLE}={name}")
    if numba.__version__.rpartition(".")[0] in TRIED and not lacking:
        return Way("private", "this version was tried")
    return _checked_way(lacking)


def _lacking() -> str:
    """Return why the private parts cannot be imported, or an empty text."""
    try:
        import vibroimpact.jit.hooks  # noqa: F401
    except Exception as error:
        return f"{type(error).__name__}: {error}".splitlines()[0][:100]
    return ""


def _checked_way(lacking: str) -> Way:
    """Return the fastest way that holds here, which is checked once and then stored."""
    processor = llvmlite.binding.get_host_cpu_name()
    machine = (NUMERICS, numba.__file__, llvmlite.__version__, sys.version, processor, lacking)
    path = root() / "numba" / hashlib.sha256(repr(machine).encode()).hexdigest()[:24]
    if (stored := read(path)) is not None:
        return Way(*stored.decode().split("\n"))
    way = _fastest(lacking)
    with suppress(OSError):
        write(path, "\n".join(way).encode())
    warnings.warn(f"numba {numba.__version__} is used {way}", NumbaWarning, stacklevel=2)
    return way


def _fastest(lacking: str) -> Way:
    """Check one way after the other until one holds."""
    reason = lacking or _why_it_fails("private")
    if not reason:
        return Way("private", f"{TRIED[0]} to {TRIED[-1]} were tried; here a check held")
    reason = f"its private parts failed: {reason}"
    if further := _why_it_fails("options"):
        return Way("plain", f"{reason}; its options failed: {further}")
    return Way("options", reason)


def _why_it_fails(name: str) -> str:
    """Return why a way fails in a process of its own, or an empty text."""
    program = "from vibroimpact.jit.trial import run_trial; run_trial()"
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {
            _VARIABLE: name,
            "NUMBA_CACHE_DIR": folder,
            "PYTHONPATH": os.pathsep.join(sys.path),
        }
        for expected in (f"{name} compiled", f"{name} loaded"):
            try:
                process = subprocess.run(
                    [sys.executable, "-P", "-c", program],
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    text=True,
                    errors="replace",
                    timeout=_SECONDS,
                )
            except (OSError, subprocess.SubprocessError) as error:
                return type(error).__name__
            if process.returncode != 0 or process.stdout.strip() != expected:
                lines = (process.stderr or process.stdout).strip().splitlines()
                return lines[-1][:100] if lines else f"its process ended with {process.returncode}"
    return ""


#: The way of this process.
WAY = _chosen()
