"""The process of a command: it listens to signals before it imports anything that takes time."""

from __future__ import annotations

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
        sys.stdout.flush()
    except OSError as error:
        _tell(f"the output cannot be written: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's own flush
        code = code or 1
    sys.exit(code)


def _run() -> int:
    try:
        from sweeps.cli.main import app
        from sweeps.cli.terminal import prepare_streams

        prepare_streams()
        interrupts.check()
        app(prog_name="vibroimpact")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    except KeyboardInterrupt:
        _tell("interrupted")
    except MemoryError:
        _tell("there is not enough memory")
    return 1


def _tell(error: str) -> None:
    print(f"vibroimpact: error: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
