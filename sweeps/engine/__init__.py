"""The run of a sweep: plan, compute, refine, workers, cluster.

Only this room imports Dask.
"""
