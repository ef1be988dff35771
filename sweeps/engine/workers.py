"""Where a sweep is computed: a `Computer` is this machine, or a cluster (``cluster.py``)."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.engine.background import in_background

Item = TypeVar("Item")
Results = dict[str, np.ndarray]

#: Computes one item of a sweep, such as a block of its grid, from the configuration, the item and
#: the number of threads: a function of a module, which a process elsewhere finds by its name.
Work = Callable[..., Results]
#: Told a number of points that are computed.
Advance = Callable[[int], object]


class Computer(Protocol):
    """Computes the items of a sweep.

    Attributes
    ----------
    threads : int or None
        Of a trial on this machine, None for all.
    cores : int
        How many times as much as such a trial is computed at once.
    """

    threads: int | None

    @property
    def cores(self) -> int: ...

    def computed(
        self,
        work: Work,
        config: SweepConfig,
        items: Sequence[Item],
        advance: Advance | None = None,
    ) -> Generator[tuple[Item, Results], None, None]:
        """Yield every item with its results, in any order, and hold few of them at a time.

        `advance` is handed to the work where that is done in this process. Where the generator is
        closed, what is still to be computed is given up.
        """

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return what ``block_size`` has to keep to, where `size` points take so many seconds."""

    def described(self) -> str:
        """Say where the work is done now, where it is not this process."""


class Local:
    """Computes on this machine, one item after the other."""

    cores = 1

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads

    def computed(
        self,
        work: Work,
        config: SweepConfig,
        items: Sequence[Item],
        advance: Advance | None = None,
    ) -> Generator[tuple[Item, Results], None, None]:
        """Yield every item with its results, in order."""
        report = () if advance is None else (advance,)
        return in_background((item, work(config, item, self.threads, *report)) for item in items)

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return none."""
        return {}

    def described(self) -> str:
        """Say nothing."""
        return ""
