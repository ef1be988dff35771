"""The run of a sweep: estimate, compute and refine it, on this machine or on a cluster.

Only this room imports Dask.
"""
