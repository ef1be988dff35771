"""The process of a command: it listens to signals before it imports anything that takes time."""

from __future__ import annotations

import gc
import os
import sys
from typing import NoReturn

from sweeps import interrupts


def main() -> NoReturn:
    """Run the command line; exits with 0 done, 1 failed or interrupted, 2 request refused."""
    interrupts.listen()
    code = _run()
    interrupts.ignore()  # the outcome is known
    try:
        if sys.stdout is not None:  # it may be closed
            sys.stdout.flush()
    except OSError as error:
        if code == 0:  # otherwise its line was written already
            _report(_reason(error))
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's own flush
        code = code or 1
    gc.freeze()  # so that Python does not search for garbage what ends with the process
    sys.exit(code)


def _run() -> int:
    """Run the command; return the exit code."""
    try:
        from sweeps.cli.main import app
        from sweeps.cli.options import prepare_streams

        prepare_streams()
        interrupts.check()
        app(prog_name="vibroimpact")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    except (interrupts.Cancelled, Exception) as error:
        if interrupts.came():  # which a library may have turned into an error of its own
            _report("interrupted")
        elif isinstance(error, MemoryError):
            _report("there is not enough memory")
        elif isinstance(error, OSError):
            _report(_reason(error))
        else:
            raise
    return 1


def _reason(error: OSError) -> str:
    """Say what went wrong with a file, or else with the standard output."""
    if error.filename is not None:
        return str(error)
    return f"the standard output cannot be written: {error.strerror or error}"


def _report(error: str) -> None:
    print(f"vibroimpact: error: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
