"""Check the environment of a command: refuse settings that would end in a traceback."""

from __future__ import annotations

import os
import resource
import warnings
from pathlib import Path

from sweeps.errors import Failed, Refused
from sweeps.text import shortened

#: Address space that a command takes before it computes a point, and for each core [bytes]. With
#: less, OpenBLAS waits forever for the memory of its threads.
_ADDRESS_SPACE, _PER_CORE = 768 << 20, 64 << 20


def check_environment() -> None:
    """Refuse too little address space, and settings of numba that it cannot read or work with.

    Raises
    ------
    Failed
        Names the limit of the address space.
    Refused
        Names the settings; numba's own error says what is wrong with one of them.
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = _ADDRESS_SPACE + _PER_CORE * (os.cpu_count() or 1)
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise Failed(
            f"there is not enough memory: the limit of the address space is {limit >> 20} MB, "
            f"expected at least {needed >> 20} MB; raise it, in a shell with ulimit -v"
        )
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "0")
    if not (epoch.isascii() and epoch.isdecimal()):  # which numpy.f2py reads, and matplotlib
        raise Refused(
            f"SOURCE_DATE_EPOCH={epoch} is not allowed; expected: a whole number of seconds"
        )
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
            f"numba cannot work with its settings: {shortened(problem, 200)}; one of "
            f"these is wrong, unset or correct it: {shortened(', '.join(settings), 300)}"
        )
