"""`Status`: the outcome of a point; `Evidence` for its class."""

from enum import IntEnum

#: A record repeats if its sections agree to within this share of its size.
TOLERANCE = 1e-6


class Flag(IntEnum):
    """A number of a file that stands for a word."""

    @property
    def word(self) -> str:
        """The name, as texts and legends write it."""
        return self.name.lower().replace("_", "-")


class Status(Flag):
    """The outcome at one parameter point, as stored in ``status``.

    ``UNRESOLVED`` and ``NON_FINITE`` are failures: the numbers of the point are NaN from then on.

    Examples
    --------
    >>> Status(1).name, Status.CERTIFIED.meaning
    ('CERTIFIED', 'computed to the end, with every impact found and none missed')
    >>> Status.NON_FINITE.failed
    True
    """

    PENDING = -1
    COMPUTED = 0
    CERTIFIED = 1
    CUT_SHORT = 2
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
        return self not in (Status.COMPUTED, Status.CERTIFIED, Status.CUT_SHORT, Status.UNBOUNDED)

    def remark(self, impact: str) -> str:
        """Return what there is to say of a point with an impact rule; nothing of a usual one.

        Examples
        --------
        >>> from vibroimpact import Status
        >>> Status.COMPUTED.remark("plain"), Status.CUT_SHORT.remark("exact")
        ('', 'bounces too short to follow were taken for rest')
        """
        if impact == "exact" and self in _OF_EXACT:
            return _OF_EXACT[self]
        if self is Status.COMPUTED:
            return ""
        return "" if self is Status.CERTIFIED else self.meaning


_MEANING = {
    Status.PENDING: "not computed yet",
    Status.COMPUTED: "computed to the end",
    Status.CERTIFIED: "computed to the end, with every impact found and none missed",
    Status.CUT_SHORT: "bounces too short to follow were taken for rest",
    Status.UNBOUNDED: "the motion grew throughout the record, in resonance (R = 1, h = 0)",
    Status.UNRESOLVED: "more impacts within one step than the impact rule can resolve",
    Status.NON_FINITE: "a number overflowed: the step is unstable, or the motion too large",
}
#: What else is said of a point with exact impacts.
_OF_EXACT = {
    Status.COMPUTED: (
        "x keeps fewer than 8 digits of the motion: the stop is far away, the motion is below "
        "1e-300, or omega^2 overflows"
    ),
    Status.NON_FINITE: "a number overflowed: the motion is too large",
}


class Evidence(Flag):
    """What shows to which periodic orbit a motion goes, as stored in ``class_evidence``.

    Up to ``UNREACHED`` the motion has no class.
    """

    PENDING = -1
    NONE = 0
    UNSTABLE = 1
    UNREACHED = 2
    REPEATS = 3
    FREE = 4
    CAPTURED = 5
    FALLING = 6
    RELEASED = 7

    @property
    def meaning(self) -> str:
        """The evidence, in words."""
        return _EVIDENCE[self]

    def reason(self, impact: str) -> str:
        """Return why a motion has no class; only with exact impacts orbits near it are sought."""
        is_sought = impact == "exact" or self is not Evidence.NONE
        return self.meaning if is_sought else "without a repetition in the record"


_EVIDENCE = {
    Evidence.PENDING: "not computed yet",
    Evidence.NONE: "near no periodic orbit",
    Evidence.UNSTABLE: "near unstable orbits only",
    Evidence.UNREACHED: "near a stable orbit that they were not shown to reach",
    Evidence.REPEATS: "the motion repeats, to the same bits or as its record shows",
    Evidence.FREE: "it has no impact any more, which is a proof",
    Evidence.CAPTURED: "an ellipse of motions around the orbit, and through this one, shrinks",
    Evidence.FALLING: "its distance from the orbit falls as the multipliers say",
    Evidence.RELEASED: "the motion repeats without the rest that is in its record",
}
