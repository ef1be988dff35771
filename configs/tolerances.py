"""Make tolerances.csv: joints whose parts scatter, sampled for Sobol indices."""

import numpy as np
import pandas as pd
from scipy import stats

PARTS = {
    "gap": stats.norm(5e-4, 1e-5),
    "restitution": stats.uniform(0.6, 0.2),
    "stiffness": stats.norm(8e3, 80),
    "force": stats.norm(8, 0.16),
}

unit = np.split(stats.qmc.Sobol(8, seed=1).random(512), 2, axis=1)
matrices = {
    name: pd.DataFrame({part: PARTS[part].ppf(u) for part, u in zip(PARTS, half.T, strict=True)})
    for name, half in zip("AB", unit, strict=True)
}
for part in PARTS:  # A, in which one part comes from B
    matrices[part] = matrices["A"].assign(**{part: matrices["B"][part]})
joints = pd.concat(matrices, names=["matrix"]).reset_index("matrix")
table = pd.DataFrame(
    {
        "clearance": joints["gap"],
        "R": joints["restitution"],
        "p": np.sqrt(joints["stiffness"] / 0.5),  # a link of 0.5 kg
        "f": joints["force"] / 0.5,
        "matrix": joints["matrix"],  # kept in the file of the sweep
    }
)
table.to_csv("tolerances.csv", index=False, float_format="%.8g")
