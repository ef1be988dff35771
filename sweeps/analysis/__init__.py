"""What recorded motions are: regimes, classes m/q and where they change, attractors, tables.

It reads opened sweeps, and goes on with motions that have not settled. Pictures are not known here.
"""
