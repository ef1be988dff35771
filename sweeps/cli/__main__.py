"""The process of a command: it handles signals before it imports any slow module."""

from __future__ import annotations

import gc
import os
import sys
from typing import NoReturn

from sweeps import interrupts


def main() -> NoReturn:
    """Run the command line and exit: 0 if done, 1 if failed or interrupted, 2 if refused."""
    interrupts.listen()
    code = _run()
    interrupts.ignore()  # the outcome is decided
    try:
        if sys.stdout is not None:  # it may be closed
            sys.stdout.flush()
    except OSError as error:
        if code == 0:  # otherwise an error was reported already
            _report(_reason(error))
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes it again
        code = code or 1
    gc.freeze()  # saves the garbage collection at exit
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
        if interrupts.signal_came():  # a library may have raised another error because of it
            _report("interrupted")
        elif isinstance(error, MemoryError):
            _report("there is not enough memory")
        elif isinstance(error, OSError):
            _report(_reason(error))
        else:
            raise
    return 1


def _reason(error: OSError) -> str:
    """Return the message of an error of a file, or of the standard output."""
    if error.filename is not None:
        return str(error)
    return f"the standard output cannot be written: {error.strerror or error}"


def _report(error: str) -> None:
    print(f"vibroimpact: error: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
