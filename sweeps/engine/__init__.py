"""The run of a sweep: plan, compute, follow, refine, workers, cluster.

Only this room imports Dask.
"""
