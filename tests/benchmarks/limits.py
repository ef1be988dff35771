"""Limits on speed: the table of limits, and the race that compares a benchmark with its limit.

No time is absolute. Every benchmark runs interleaved with a reference on the same machine. Times
are CPU times, which other processes affect little, and the best round of each counts. The ratio of
the two best rounds is compared with the limit.
"""

from __future__ import annotations

import math
import resource
import time

import llvmlite.binding as llvm
import numba
from numba import njit

_STEPPING = ("euler", "semi-implicit-euler", "verlet", "newmark", "rk4")
#: The limits for vectors of 512 and of 256 bits: two thirds above values measured on one server
#: processor (Sapphire Rapids; for reduced-step: Zen 4). There the best round repeats to 10 %; the
#: rest of the margin is for other processors. A loop that is no longer vectorized takes three times
#: as long. The methods run in chaos, where no motion comes back, so that every period is computed.
#: Unless noted, the unit is a step of the yardstick per forcing period of one point.
LIMITS = {
    # On one processor (Zen) 1.8 to 2.1; but 3.4 to 3.8 for minutes while another machine works on
    # the same cores, which slows down vectors but not the reference. Without vectors it is 4.65;
    # with vectors of 256 bits 2.75, which ``test_vectors.py`` finds in the machine code.
    **{f"plain, {integrator}": (4.2, 4.88) for integrator in _STEPPING},
    "plain, exact": (4.2, 5.0),
    "plain, rk4, all recorded": (5.12, 8.25),
    **{f"reduced-step, {integrator}": (5.8, 8.3) for integrator in _STEPPING},
    "reduced-step, exact": (8.8, 10.8),
    # On another processor (Zen) 11.6, 9.0 to 11.1, 7.8 to 9.4, 7.6 to 8.3, 8.4 to 10.1, 9.5.
    "cubic, euler": (18.1, 23.2),
    "cubic, semi-implicit-euler": (17.0, 22.0),
    "cubic, verlet": (14.0, 17.5),
    "cubic, newmark": (13.5, 17.5),
    "cubic, rk4": (15.0, 19.5),
    "cubic, exact": (16.0, 20.5),
    "exact, exact": (4.5, 5.7),
    # A period with exact impacts against one with the rule plain, both computed. Where steps with
    # several impacts left the vectors, it was 1.9 and 1.4 in chaos, and 7 in rattling.
    "exact / plain, quickstart": (1.5, 1.2),
    "exact / plain, chaos": (1.7, 1.35),
    "exact / plain, one impact": (1.3, 1.0),
    "exact / plain, rattling": (1.7, 2.0),
    "exact / plain, chatter": (2.0, 2.0),
    "exact / plain, rests": (1.5, 1.3),
    "exact / plain, fast forcing": (1.0, 0.7),
    # Measured 5.6 to 7.8; 11 without vectors.
    "chatter": (10.0, 10.0),
    "Lyapunov exponents on / off": (2.1, 2.2),
    # Measured 1.27 to 1.38, and 1.19 to 1.30: long cycles with rest are compared with others. In
    # the chaos of the map the sweep itself is fast.
    "classes of a map on / off": (1.7, 1.7),
    "classes of a diagram on / off": (1.5, 1.5),
    "the busier thread's share of both threads' time": (0.9, 0.9),
    # A short sweep: starting, laying out and writing take longer than the kernel. Measured 4.9 to
    # 6.4 with vectors of 512 bits, with which the kernel takes least.
    "run, from YAML to the closed file / kernel alone": (8.5, 8.5),
    # Yardstick steps per number.
    # Every block is a file of its own before it is written to the HDF5 file. Measured 1.7 to 2.6.
    "store, written": (3.5, 3.5),
    "store, read": (1.6, 1.6),
    # Measured 7 to 8, where the bare interpreter starts in 10 ms.
    "--help / the bare interpreter": (11.0, 11.0),
    # Measured 1.5 to 1.65; 2.0 where SciPy and all that numba can compile are imported, too.
    "a second run / importing what it needs": (1.9, 1.9),
}


#: Rounds after a ratio above its limit, half a second and more apart.
_FURTHER_ROUNDS = 60


#: Steps in one call.
STEPS = 40_000
_H, _R, _OMEGA, _PER_PERIOD = 0.1, 0.8, 2.3, 100


@njit
def yardstick():
    """Run RK4 and the rule (2)-(5) for one point, as a competent user would write it.

    Do not change it: the limits are ratios to its time.
    """
    T = 2.0 * math.pi / _OMEGA / _PER_PERIOD
    x = v = 0.0
    for k in range(STEPS):
        t = k * T
        s0, s1 = math.sin(_OMEGA * t), math.sin(_OMEGA * (t + T / 2))
        s2 = math.sin(_OMEGA * (t + T))
        k1 = -2 * _H * v - x - s0
        v2 = v + T / 2 * k1
        k2 = -2 * _H * v2 - (x + T / 2 * v) - s1
        v3 = v + T / 2 * k2
        k3 = -2 * _H * v3 - (x + T / 2 * v2) - s1
        v4 = v + T * k3
        k4 = -2 * _H * v4 - (x + T * v3) - s2
        x += T / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += T / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if x >= 0.0 and v > 0.0:
            x, v = 0.0, -_R * v
    return x, v


def cpu_features() -> frozenset[str]:
    """Return the names of the processor features that numba compiles for."""
    features = numba.config.CPU_FEATURES or llvm.get_host_cpu_features().flatten()
    return frozenset(name[1:] for name in features.split(",") if name.startswith("+"))


def limit(name: str) -> float:
    """Return the limit of a benchmark on this processor; inf if it has neither vector size."""
    features = cpu_features()
    if "avx2" not in features:
        return math.inf
    return LIMITS[name]["avx512f" not in features]


def cpu_seconds() -> float:
    """Return the CPU time of this process, including threads and finished child processes."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _clocked(call):
    """Return the CPU time of a call."""
    began = cpu_seconds()
    call()
    return cpu_seconds() - began


class Race:
    """Runs one benchmark interleaved with its reference, and lists its name, ratio and limit."""

    def __init__(self, benchmark, ratios):
        self._benchmark, self._ratios = benchmark, ratios

    def run(self, name, ours, reference=yardstick, *, amount=1.0, of_reference=STEPS, rounds=15):
        """Warm both up, time both in turn, and compare the ratio of the best rounds with the limit.

        `amount` and `of_reference` are the work of a call of each, in forcing periods and steps.
        Other work on the processor can slow down vectors for seconds but not the reference, so a
        ratio above the limit is measured again, for at most a minute. Returns the result of `ours`.
        """
        spent = []

        def clock_reference():
            spent.append(_clocked(reference))

        result = self._benchmark.pedantic(
            ours, setup=clock_reference, rounds=rounds, warmup_rounds=1
        )
        best, fair = self._benchmark.stats.stats.min, limit(name) * amount / of_reference
        for _ in range(_FURTHER_ROUNDS):
            if best <= fair * min(spent[1:]):
                break
            time.sleep(0.5)
            clock_reference()
            best = min(best, _clocked(ours))
        self.hold(name, best / amount / (min(spent[1:]) / of_reference))
        return result

    def hold(self, name, ratio):
        """Record a ratio, and compare it with its limit."""
        self._benchmark.extra_info.update(name=name, ratio=ratio, limit=limit(name))
        self._ratios.append((name, ratio, limit(name)))
        assert ratio <= limit(name), f"{name}: {ratio:.3g}, limit {limit(name):.3g}"
