"""Analysis of recorded motions: regimes, classes m/q and their changes, attractors, tables.

This room reads opened sweeps, and continues motions that go to no known attractor. It returns data,
and draws no pictures.
"""
