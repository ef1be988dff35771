"""The process that compiles beside a run on another core."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.console import Console

from sweeps.engine.estimate import COMPILING_MEMORY, available_memory
from vibroimpact.jit import ALL_THREADS, COMPILING, watched

#: Compiles the search for classes, and ends with the process that started it, whose end closes its
#: input: first as after Ctrl-C, which leaves no lock, but not later than some seconds after.
_PROGRAM = """
import _thread, os, sys, threading, time
def end():
    sys.stdin.read()
    _thread.interrupt_main()
    time.sleep(5.0)
    os._exit(1)
threading.Thread(target=end, daemon=True).start()
from vibroimpact.kernel.threads import compile_search
compile_search()
"""


@contextmanager
def preparing(console: Console, cores: int | None, classes: bool) -> Iterator[None]:
    """Say what is compiled: on a terminal while it is, in a log in one line.

    If the loop is compiled here, and `classes` are asked for, another process compiles the search
    for them meanwhile, where a second core is allowed.
    """
    told = set()
    with console.status("preparing") as status:

        def watch(text: str) -> None:
            status.update(text or "preparing")
            if text and text not in told:
                told.add(text)
                if not console.is_terminal:
                    console.print(text)
                if text == COMPILING and classes and min(cores or ALL_THREADS, ALL_THREADS) > 1:
                    compile_beside()

        with watched(watch):
            yield


def compile_beside() -> None:
    """Let another process compile the search for classes, if there is enough memory for it.

    Whatever comes of it, this process waits for that code, loads it, or compiles it itself.
    """
    # In a program that embeds Python, the executable is that program.
    if available_memory() < 2 * COMPILING_MEMORY or "python" not in Path(sys.executable).name:
        return

    command = [sys.executable, "-P", "-c", _PROGRAM]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    null = subprocess.DEVNULL

    def run() -> None:
        with (
            suppress(OSError),
            subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=null, stderr=null
            ) as process,
        ):
            process.wait()  # and its input stays open

    threading.Thread(target=run, daemon=True).start()
