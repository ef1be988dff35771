"""What became of a parameter point."""

from enum import IntEnum


class Status(IntEnum):
    """The outcome at one parameter point, as stored in ``status``.

    A point whose status is not ``COMPUTED`` holds NaN from the moment the method failed.
    """

    PENDING = -1
    COMPUTED = 0
    UNRESOLVED = 1
    NON_FINITE = 2

    @property
    def meaning(self) -> str:
        """The outcome, in words."""
        return _MEANING[self]


_MEANING = {
    Status.PENDING: "not computed yet",
    Status.COMPUTED: "computed to the end",
    Status.UNRESOLVED: "more impacts within one step than the impact rule can resolve",
    Status.NON_FINITE: "the state overflowed: the step is unstable or the motion unbounded",
}
