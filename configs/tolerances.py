"""Make tolerances.csv: joints whose parts scatter, sampled for Sobol indices."""

import numpy as np
from scipy import stats

parts = [stats.norm(5e-4, 1e-5), stats.uniform(0.6, 0.2), stats.norm(8e3, 80), stats.norm(8, 0.16)]
unit = np.split(stats.qmc.Sobol(8, seed=1).random(512).T, 2)
a, b = (np.array([part.ppf(u) for part, u in zip(parts, half, strict=True)]) for half in unit)
mixed = [np.where(np.arange(4)[:, None] == i, b, a) for i in range(4)]  # a, with one part from b
gap, R, stiffness, force = np.concatenate([a, b, *mixed], axis=1)
table = np.transpose([gap, R, np.sqrt(stiffness / 0.5), force / 0.5])  # a link of 0.5 kg
np.savetxt("tolerances.csv", table, "%.8g", ",", header="clearance,R,p,f", comments="")
