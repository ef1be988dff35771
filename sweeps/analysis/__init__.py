"""Analysis of recorded motions: regimes, classes m/q and their changes, attractors, tables.

This room reads opened sweeps, and continues motions that have not settled. It draws no pictures.
"""
