"""The process of a command: its signals, its exit code, an output that cannot be written.

It notes signals before it imports any module but those that Python has loaded when it starts:
``signal`` would import ten others, and a signal that arrives meanwhile would end the process with a
traceback.
"""

import _signal  # type: ignore[import-not-found]
import os
import sys

#: As in `sweeps.interrupts`, which is not imported yet.
NOTED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGXCPU", "SIGBREAK")
_OUTPUT = "the standard output cannot be written: {}"


def main() -> None:
    """Run the command line and exit: 0 if done, 1 if failed or interrupted, 2 if refused."""
    came = _noted()
    if not any(word.startswith("--dask") for word in sys.argv):
        # At the first variable xarray would import all of it, which takes as long as xarray itself.
        sys.modules.setdefault("dask", None)  # type: ignore[arg-type]
    import sweeps.interrupts as interrupts  # not from sweeps: it would import all its names

    interrupts.listen(came)
    code = _exit_code()
    interrupts.ignore()  # the outcome is decided
    try:
        if sys.stdout is not None:  # it may be closed
            sys.stdout.flush()
    except OSError as error:
        if code == 0:  # otherwise an error was reported already
            _report(_OUTPUT.format(error.strerror or error))
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes it again
        code = code or 1
    import gc

    gc.freeze()  # saves the garbage collection at exit
    sys.exit(code)


def _noted() -> list[int]:
    """Return a list to which signals are appended, except those that are ignored."""
    came: list[int] = []
    for name in NOTED:
        number = getattr(_signal, name, None)  # no system has all of them
        if number is not None and _signal.getsignal(number) is not _signal.SIG_IGN:
            _signal.signal(number, lambda number, _: came.append(number))
    return came


def _exit_code() -> int:
    """Run the command, and report its error; return the exit code."""
    import sweeps.interrupts as interrupts

    try:
        from sweeps.cli.common import prepare_streams
        from sweeps.cli.main import app

        prepare_streams()
        interrupts.check()
        return app(prog_name="vibroimpact", standalone_mode=False) or 0
    except SystemExit as end:  # of a shell's request for completions
        return end.code if isinstance(end.code, int) else 1
    except (interrupts.Cancelled, Exception) as error:
        from sweeps.errors import Failed, Refused

        came = interrupts.signal_came() and not isinstance(error, Failed)
        if came or isinstance(error, interrupts.Cancelled):
            _report("interrupted")  # a library may have raised another error because of it
            return 1
        if isinstance(error, Failed | Refused):
            _report(str(error))
        elif isinstance(error, ImportError) and error.name == "vibroimpact":
            print(f"vibroimpact: error: {error}", file=sys.stderr)  # in a ZIP, without `printable`
        elif isinstance(error, MemoryError):
            _report("there is not enough memory")
        elif isinstance(error, OSError):
            _report(_reason(error))
        elif hasattr(error, "format_message"):  # a usage error, whose class typer does not export
            from sweeps.cli.common import unreadable

            _report(unreadable(error))
            return 2
        else:
            raise
        return 2 if isinstance(error, Refused) else 1


def _reason(error: OSError) -> str:
    """Return the message of an error of a file, or of the standard output."""
    if error.filename is not None or error.errno is None:  # it says all that is known
        return str(error)
    import typer

    reason, called = error.strerror or error, error.__traceback__
    while called is not None:
        if called.tb_frame.f_code is typer.echo.__code__:
            return _OUTPUT.format(reason)
        called = called.tb_next
    return f"a file cannot be read or written: {reason}"


def _report(error: str) -> None:
    """Print an error on stderr, unless that is closed."""
    from sweeps.text import printable

    if sys.stderr is not None:
        print(printable(f"vibroimpact: error: {error}"), file=sys.stderr)


if __name__ == "__main__":
    main()
