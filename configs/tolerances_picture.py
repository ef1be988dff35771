"""Draw tolerances.png from tolerances.h5: impulse, classes of motion, and causes of the scatter."""

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

from sweeps import open_sweep
from sweeps.opened.opened_sweep import OpenedSweep

MASS = 0.5  # kg
PARTS = ["gap", "restitution", "stiffness", "force"]


def independent(sweep):
    """Return whether each joint has independent parts, as in the matrices A and B."""
    return np.isin(sweep["matrix"], ["A", "B"])


def classes(sweep):
    """Return the number of each class of motion among the joints with independent parts."""
    found = OpenedSweep(sweep.isel(point=independent(sweep))).labels
    names, counts = np.unique([str(label or "unknown") for label in found], return_counts=True)
    return dict(zip(names.tolist(), counts.tolist(), strict=True))


def indices(result):
    """Return the Sobol indices of a result of every joint, of first order and total, (4,) each."""
    result = result - result.mean()
    of = {name: [result.values[result.matrix == name]] for name in ("A", "B", *PARTS)}
    func = {"f_A": of["A"], "f_B": of["B"], "f_AB": [of[part] for part in PARTS]}
    func = {name: np.array(values) for name, values in func.items()}
    found = stats.sobol_indices(func=func, n=func["f_A"].size)
    return np.ravel(found.first_order), np.ravel(found.total_order)


def draw(sweep):
    """Return the figure."""
    impulse, drawn = 1e3 * MASS * sweep.impulse, independent(sweep)
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
    left.hist(impulse.values[drawn], bins=50, color="#0072B2")
    left.set(xlabel="impulse on the stop in a period [mN s]", ylabel=f"joints of {drawn.sum():,}")
    for i, count in enumerate(classes(sweep).values()):
        share = stats.binomtest(count, int(drawn.sum()))
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
