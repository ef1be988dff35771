"""A run: its estimate, its blocks in a thread or on a cluster.

Only this room imports Dask.
"""
