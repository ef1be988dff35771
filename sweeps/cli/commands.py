"""A group of commands: its list, and the only place where an error becomes an exit code."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

import typer
from typer.core import TyperGroup

from sweeps.cli.options import say
from sweeps.errors import Failed, Refused
from sweeps.interrupts import Cancelled
from sweeps.text import near_miss, shortened, suggestion

#: Raised by typer for arguments that it cannot read. It exports only a subclass of it.
_Unreadable = cast("type[Exception]", typer.BadParameter.__mro__[1])


class Commands(TyperGroup):
    """Commands whose errors are printed as one paragraph."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments before the name of the command; without any, print the help."""
        if not args:
            say(ctx.get_help(), error=True)
            raise typer.Exit(2)
        with _reported(ctx):
            return super().parse_args(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command with this name; refuse a name that no command has."""
        if (command := super().get_command(ctx, cmd_name)) is None:
            meant = suggestion(near_miss(cmd_name, self.commands))
            raise Refused(
                f"there is no command {cmd_name}{meant}; expected: {', '.join(self.commands)}"
            )
        return command

    def invoke(self, ctx: Any) -> Any:
        """Run the command; if it refuses or fails, print the error and exit with its code."""
        with _reported(ctx):
            return super().invoke(ctx)


def add(app: typer.Typer, *commands: Callable[..., None]) -> None:
    """Add the command ``run`` for ``run_command``, with its whole first line in the list."""
    for command in commands:
        name = command.__name__.removesuffix("_command").replace("_", "-")
        app.command(name, short_help=command.__doc__)(command)


@contextmanager
def _reported(ctx: Any) -> Iterator[None]:
    """Print an error raised in the block, and exit with its code."""
    try:
        yield
        return
    except (Cancelled, KeyboardInterrupt):  # KeyboardInterrupt if our handlers are not active
        error, code = "interrupted", 1
    except Failed as failure:
        error, code = str(failure), 1
    except Refused as refusal:
        error, code = str(refusal), 2
    except _Unreadable as unreadable:
        error, code = _unreadable(unreadable, ctx), 2
    say(f"vibroimpact: error: {error}", error=True)
    raise typer.Exit(code)


def _unreadable(error: Any, ctx: Any) -> str:
    """Return the message of arguments that typer cannot read, with the command that explains."""
    path = " ".join(filter(None, [ctx.command_path, ctx.invoked_subcommand]))
    if hasattr(error, "possibilities"):
        meant = suggestion(next(iter(error.possibilities or ()), None))
        text = f"there is no option {error.option_name}{meant}"
    else:
        text = error.format_message().rstrip(".")
        text = text[0].lower() + text[1:]
    return f"{shortened(text, 200)}; {path} --help shows what is allowed"
