"""The memory that is available: that of the machine, or less where a container limits it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

#: For a control group of either version: its limit, what it uses, and what of that is a copy of
#: files, which the system drops when memory is needed.
_V2 = ("memory.max", "memory.current", ("inactive_file", "active_file"))
_V1 = (
    "memory.limit_in_bytes",
    "memory.usage_in_bytes",
    ("total_inactive_file", "total_active_file"),
)


def available_memory(
    process: Path = Path("/proc/self/cgroup"), groups: Path = Path("/sys/fs/cgroup")
) -> int:
    """Return the available memory in bytes: the least of the machine and of all control groups."""
    import psutil

    return min([int(psutil.virtual_memory().available), *_left_in_groups(process, groups)])


def _left_in_groups(process: Path, groups: Path) -> Iterator[int]:
    """Yield what each control group of this process with a limit has left, also those above it.

    In a container its own group is the root, although `process` may name the path outside.
    """
    for line in _lines(process):
        _, controllers, group = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root, names = (groups / "memory", _V1) if controllers else (groups, _V2)
        inside = PurePosixPath(group.lstrip("/"))
        for part in (inside, *inside.parents):
            if (left := _left(root / part, *names)) is not None:
                yield left


def _left(group: Path, limit: str, used: str, reclaimed: tuple[str, ...]) -> int | None:
    """Return the bytes that a group has left; None without a limit, or if it cannot be read."""
    most, taken = _lines(group / limit), _lines(group / used)
    if not most or not taken or not most[0].isdigit():  # "max" is no limit
        return None
    statistics = dict(line.split(" ", 1) for line in _lines(group / "memory.stat"))
    dropped = sum(int(statistics.get(name, 0)) for name in reclaimed)
    return max(0, int(most[0]) - max(0, int(taken[0]) - dropped))


def _lines(path: Path) -> list[str]:
    """Return the lines of a file of the system; none if it cannot be read, or does not exist."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
