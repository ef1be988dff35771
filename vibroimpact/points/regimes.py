"""`Regime` (periodic, rest, chaotic, unknown) and class (`Label`) of a motion by its record.

The record of a point determines its regime. The first of these rules that applies decides:

1. not computed, failed or unbounded: according to ``status``;
2. rest: the mass rested on the stop during the record, after a complete chatter or, with R = 0,
   after an impact, unless it was shown to go to an orbit without rest. If such a motion was shown
   to repeat, its forcing periods are known, but its number of impacts depends on where a chatter
   is cut off;
3. periodic: the periodic orbit is known to which the motion goes (`vibroimpact.destination`);
4. chaotic: the larger Lyapunov exponent is recorded, and `is_chaotic`;
5. unknown: all others. They may be quasi-periodic, chaotic or on their way to an orbit.

The class of a motion is its regime with m and q.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.status import TOLERANCE, Evidence, Flag, Status


class Regime(Flag):
    """The regime of a motion according to its record."""

    PENDING = 0
    FAILED = 1
    UNBOUNDED = 2
    REST = 3
    PERIODIC = 4
    CHAOTIC = 5
    UNKNOWN = 6


#: The outcomes that leave no result.
_FAILED = [status for status in Status if status.failed]
#: Most periods of motions with rest that are listed.
_MOST_PERIODS = 3
#: What is said of a periodic motion; of other motions, the word of their regime.
SETTLED, ON_ITS_WAY = "settled on m/q", "on its way to m/q"
UNKNOWN, RESTING = Regime.UNKNOWN.word, Regime.REST.word
#: Regimes of motions that go to no known attractor but chaos.
NO_CLASS = (Regime.CHAOTIC, Regime.UNKNOWN)
#: The results that determine a regime.
OF_REGIMES = ("status", "rest_fraction", "period", "class_evidence")
#: What shows that a motion goes to an orbit without rest.
_WITHOUT_REST = (Evidence.FREE, Evidence.CAPTURED, Evidence.FALLING, Evidence.RELEASED)
#: Regimes that are classes; of the others the attractor is not known.
_CLASSIFIED = (Regime.UNBOUNDED, Regime.REST, Regime.PERIODIC, Regime.CHAOTIC)
#: Least periods of a record that shows chaos: in shorter ones stable motions show growth, too.
_PERIODS_OF_CHAOS = 32


class Label(NamedTuple):
    """The class of a motion: its regime, with m forcing periods and q impacts if known, else 0.

    Both are known for periodic motions, and m for motions with rest that were shown to repeat. With
    R = 0 these have q, too: no chatter is cut off.
    """

    regime: Regime
    m: int = 0
    q: int = 0

    def __str__(self) -> str:
        if self.regime is Regime.UNKNOWN:
            return "?"
        if self.regime is Regime.PERIODIC:
            return f"{self.m}/{self.q}"
        if self.regime is Regime.REST:
            return f"{RESTING} {self.m}/{self.q}" if self.q else rest_of([self.m])
        return self.regime.word

    def doubles_to(self, other: Label) -> bool:
        """Whether the other motion has twice m and q of this periodic motion, as after a flip."""
        return self.regime is Regime.PERIODIC and other == (self.regime, 2 * self.m, 2 * self.q)


def rest_of(periods: Iterable[int]) -> str:
    """Name motions with rest by the forcing periods after which they repeat, 0 where not known.

    >>> rest_of([1]), rest_of([6, 3, 6]), rest_of([0]), rest_of([9, 5, 7, 6])
    ('rest, 1 period', 'rest, 3, 6 periods', 'rest', 'rest, 5, 7, 9, ... periods')
    """
    known = [*dict.fromkeys(m for m in periods if m)]
    if not known:
        return RESTING
    first = sorted(known[:_MOST_PERIODS])
    listed = [*map(str, first), *["..."] * (len(known) > _MOST_PERIODS)]
    return f"{RESTING}, {', '.join(listed)} period{'s' * (known != [1])}"


def has_result(status: np.ndarray) -> np.ndarray:
    """Return the mask of points that were computed and did not fail."""
    return ~np.isin(status, _FAILED)


def rests(results: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the mask of motions with rest, given ``rest_fraction`` and ``class_evidence``.

    A motion that goes to an orbit without rest does not rest again.
    """
    mask: np.ndarray = results["rest_fraction"] > 0.0
    return mask & ~np.isin(results["class_evidence"], _WITHOUT_REST)


def is_chaotic(lyapunov: np.ndarray, omega: np.ndarray, periods: int) -> np.ndarray:
    """Return whether the exponents (..., 2) of a record of `periods` k forcing periods show chaos.

    Over the time t of the record tangent vectors grow by exp(lambda_1 t). On a torus they grow at
    most linearly, by C k with an unknown C of the order of 1, and on the way to a stable orbit
    only for a while: growth by more than k in a long record is chaos, or a long chaotic transient.
    """
    growth: np.ndarray = lyapunov[..., 0] * (periods * 2.0 * np.pi / omega)
    return (growth > np.log(periods)) & (periods >= _PERIODS_OF_CHAOS)


def chaos_hint(names: Container[Any], periods: int) -> str:
    """Say what would tell which unknown motions are chaotic; "" if results of these names do."""
    is_long = periods >= _PERIODS_OF_CHAOS
    least = "" if is_long else f" of {_PERIODS_OF_CHAOS} or more periods"
    is_told = is_long and "lyapunov" in names
    return "" if is_told else f"; Lyapunov exponents{least} tell which are chaotic"


def regimes_of(results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int) -> np.ndarray:
    """Return the `Regime` of results of any shape (...), from records of `periods` forcing periods.

    The results are those of ``OF_REGIMES``, as in a file, and ``lyapunov``, which may be missing,
    of shape (..., 2). `omega` is broadcast against them.
    """
    status = results["status"]
    rules = [
        (status == Status.PENDING, Regime.PENDING),
        (~has_result(status), Regime.FAILED),
        (status == Status.UNBOUNDED, Regime.UNBOUNDED),
        (rests(results), Regime.REST),
        (results["period"] > 0, Regime.PERIODIC),
    ]
    if "lyapunov" in results:
        rules.append((is_chaotic(results["lyapunov"], omega, periods), Regime.CHAOTIC))
    return np.select(
        [condition for condition, _ in rules],
        [int(regime) for _, regime in rules],
        int(Regime.UNKNOWN),
    )


def shown_in_part(results: Mapping[str, np.ndarray], periods: int, width: int) -> np.ndarray:
    """Return the mask of motions of which less than a repetition of impacts was kept.

    At most `width` impacts were, of a record of `periods` forcing periods. Where no class is known,
    the impacts of a forcing period count as a repetition.
    """
    repetition = per_period = results["impacts_per_period"]
    if "period" in results:
        repetition = np.where(results["period"] > 0, results["period_impacts"], per_period)
    return (repetition > width) & (impacts_met(per_period, periods) > width)


def impacts_met(per_period: np.ndarray, periods: int) -> np.ndarray:
    """Return the number of impacts in records of `periods` forcing periods; 0 for NaN."""
    return np.rint(np.nan_to_num(per_period) * periods).astype(int)


def on_its_way(regimes: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return the mask of periodic motions not on their orbit yet, by their ``orbit_distance``."""
    return (regimes == Regime.PERIODIC) & (distance > TOLERANCE)  # False for NaN


def by_destination(regimes: np.ndarray, distance: np.ndarray) -> dict[str, np.ndarray]:
    """Return the masks of the points with a result, each in one, by what is said of the motion."""
    going = on_its_way(regimes, distance)
    return {
        SETTLED: (regimes == Regime.PERIODIC) & ~going,
        ON_ITS_WAY: going,
        **{
            regime.word: regimes == regime
            for regime in (Regime.REST, Regime.CHAOTIC, Regime.UNBOUNDED, Regime.UNKNOWN)
        },
    }


def repetitions(
    regimes: np.ndarray, period: np.ndarray, impacts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return m and q of motions, given their results; 0 if the motion has none.

    Motions with rest have m if they were shown to repeat, and no q.
    """
    repeats = np.isin(regimes, (Regime.PERIODIC, Regime.REST))
    return np.where(repeats, period, 0), np.where(regimes == Regime.PERIODIC, impacts, 0)


def labels_of(
    regimes: np.ndarray, period: np.ndarray, impacts: np.ndarray, R: np.ndarray
) -> list[Label | None]:
    """Return the class of each motion, given arrays of shape (n,); None if it is not known.

    Motions with rest have q only if R is 0 at all points.
    """
    m, q = repetitions(regimes, period, impacts)
    if not R.any():
        q = np.where(regimes == Regime.REST, impacts, q)
    return [
        Label(Regime(regime), *mq) if regime in _CLASSIFIED else None
        for regime, *mq in zip(regimes.tolist(), m.tolist(), q.tolist(), strict=True)
    ]
