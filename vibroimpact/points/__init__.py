"""The points of a sweep: each from its own start, scaled along f, or followed.

Everything that determines the numbers of a sweep is in `vibroimpact`; ``jit.NUMERICS`` is the
digest of its sources.
"""
