"""The points of a grid: each from its own start, once for all f, or from its neighbour's end.

Everything that determines the numbers of a sweep is in `vibroimpact`; ``jit.NUMERICS`` is the
digest of its sources.
"""
