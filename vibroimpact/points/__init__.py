"""The points of a grid: each from its own start, once for all f, or from its neighbour's end.

What determines the numbers of a sweep lies in `vibroimpact`, whose sources ``jit.NUMERICS`` names.
"""
