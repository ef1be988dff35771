"""Draw tolerances.png from tolerances.h5: impulse, classes of motion, and causes of the scatter."""

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

from sweeps import open_sweep

N, MASS = 512, 0.5  # joints in each block of the table; kg
PARTS = ["gap", "restitution", "stiffness", "force"]


def classes(sweep):
    """Return the number of each class m/q, and all, among the joints of the first two blocks."""
    first = sweep.isel(point=slice(2 * N))
    pairs = np.stack([first.period, first.period_impacts], axis=1)
    names, counts = np.unique(pairs, axis=0, return_counts=True)
    return {
        f"{m}/{q}" if m else "undecided": int(k) for (m, q), k in zip(names, counts, strict=True)
    }


def indices(values):
    """Return the Sobol indices of a result of every row, of first order and total, (4,) each."""
    f_a, f_b, *f_ab = (values - values.mean()).reshape(-1, 1, N)  # the blocks of the table
    found = stats.sobol_indices(func={"f_A": f_a, "f_B": f_b, "f_AB": np.array(f_ab)}, n=N)
    return np.ravel(found.first_order), np.ravel(found.total_order)


def draw(sweep):
    """Return the figure."""
    impulse = 1e3 * MASS * sweep.impulse.values
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
    left.hist(impulse[: 2 * N], bins=50, color="#0072B2")
    left.set(xlabel="impulse on the stop in a period [mN s]", ylabel="joints of 1,024")
    for i, count in enumerate(classes(sweep).values()):
        share = stats.binomtest(count, 2 * N)
        low, high = share.proportion_ci(0.95, method="wilson")
        middle.vlines(i, low, high, color="#0072B2")
        middle.plot(i, share.statistic, "o", color="#0072B2")
        middle.text(i, high + 0.02, f"{low:.3f} .. {high:.3f}", ha="center")
    middle.set(
        xlim=(-0.6, i + 0.6),
        ylim=(0, 1),
        xlabel="class of motion",
        ylabel="probability, Wilson 95 %",
    )
    middle.set_xticks(range(i + 1), [*classes(sweep)])
    for shift, found, name in zip(
        (-0.2, 0.2), indices(impulse), ("first order", "total"), strict=True
    ):
        right.bar(
            np.arange(4) + shift,
            found,
            0.4,
            label=name,
            color="#0072B2" if shift < 0 else "#E69F00",
        )
    right.set_xticks(range(4), PARTS, rotation=20)
    right.set(ylabel="Sobol index of the impulse", ylim=(0, 1.1))
    right.legend(frameon=False)
    return figure


if __name__ == "__main__":
    with open_sweep("tolerances.h5") as opened:
        draw(opened).savefig("tolerances.png", dpi=200)
