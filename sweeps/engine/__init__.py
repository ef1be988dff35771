"""The run of a sweep: plan, compute, refine; executors here and on a cluster.

Only this room imports Dask.
"""
