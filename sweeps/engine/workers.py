"""Where the blocks of a sweep are computed: on this machine, or on a cluster (``cluster.py``)."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.engine.background import in_background
from sweeps.engine.compute import compute_block
from sweeps.grid import Block
from vibroimpact.jit import ALL_THREADS
from vibroimpact.lanes.kernel import FEWEST_LANES

if TYPE_CHECKING:
    from distributed import Client

    from sweeps.engine.cluster import Cluster


class Local:
    """Computes blocks on this machine, one after the other, with so many threads; None for all."""

    cores = 1  #: Number of parallel computations, in units of one trial.

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads

    def computed(
        self, config: SweepConfig, blocks: Iterable[Block], advance: Callable[[int], object]
    ) -> Generator[tuple[Block, dict[str, np.ndarray]], None, None]:
        """Yield every block with its results, in order; `advance` is as for `compute_block`.

        Where the generator is closed, what is still to be computed is given up.
        """
        return in_background(
            (block, compute_block(config, block, self.threads, advance)) for block in blocks
        )

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return how large blocks are to be, so that every thread has points."""
        return {"least": min(size, FEWEST_LANES * (self.threads or ALL_THREADS))}

    def described(self) -> str:
        """Say nothing of where the work is done."""
        return ""


Computer: TypeAlias = "Local | Cluster"


def computer_for(client: Client | None, threads: int | None) -> Computer:
    """Return what computes: the workers of a client, or so many threads of this machine."""
    if client is None:
        return Local(threads)
    from sweeps.engine.cluster import Cluster  # with asyncio, which takes long to import

    return Cluster(client)
