"""The run of a sweep: estimate and compute it, on this machine or on a cluster.

Only this room imports Dask.
"""
