"""What is set around a command: refused where a library would end in a traceback."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from sweeps.errors import Refused
from sweeps.text import shortened


def check_environment() -> None:
    """Refuse settings of numba that it cannot read, or cannot work with.

    Raises
    ------
    Refused
        Names the settings; numba's own error says what is wrong with one of them.
    """
    file = Path(".numba_config.yaml")
    settings = [f"{name}={value}" for name, value in os.environ.items() if name[:6] == "NUMBA_"]
    settings += [f"the file {file}"] if file.exists() else []
    if not settings:
        return  # and import nothing
    problem = ""
    with warnings.catch_warnings(record=True) as unread:
        warnings.simplefilter("always")
        try:
            import vibroimpact.jit  # noqa: F401 - it needs the compiler
        except Exception as error:
            problem = str(error)
    for warning in unread:
        if "Environment variable" in str(warning.message):
            problem = problem or str(warning.message).partition("\n")[0]
    if problem:
        raise Refused(
            f"numba cannot work with its settings: {shortened(problem, 200)}; unset or correct "
            f"what is wrong of {shortened(', '.join(settings), 300)}"
        )
