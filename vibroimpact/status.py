"""The outcome of a parameter point."""

from enum import IntEnum


class Status(IntEnum):
    """The outcome at one parameter point, as stored in ``status``.

    ``UNRESOLVED`` and ``NON_FINITE`` are failures: the numbers of the point are NaN from then on.
    """

    PENDING = -1
    COMPUTED = 0
    CERTIFIED = 1
    SETTLED = 2
    UNBOUNDED = 3
    UNRESOLVED = 4
    NON_FINITE = 5

    @property
    def meaning(self) -> str:
        """The outcome, in words."""
        return _MEANING[self]

    @property
    def failed(self) -> bool:
        """Whether there is no result: the point failed, or is not computed yet."""
        return self not in (Status.COMPUTED, Status.CERTIFIED, Status.SETTLED, Status.UNBOUNDED)


_MEANING = {
    Status.PENDING: "not computed yet",
    Status.COMPUTED: "computed to the end",
    Status.CERTIFIED: "computed to the end, with every impact found and none missed",
    Status.SETTLED: "bounces too short to follow were taken for rest",
    Status.UNBOUNDED: "the motion grew throughout the record (R = 1, h = 0: no dissipation)",
    Status.UNRESOLVED: "more impacts within one step than the impact rule can resolve",
    Status.NON_FINITE: "a number overflowed: the step is unstable, or the motion too large",
}
