"""What recorded motions are: regimes, classes m/q and where they change, attractors, tables.

It reads opened sweeps; how they were computed and how they are drawn is not known here.
"""
