"""The run of a sweep: estimate, compute, refine; executors here and on a cluster.

Only this room imports Dask.
"""
