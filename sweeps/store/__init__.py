"""The HDF5 file of a sweep: variables, layout, creation, writing, reading.

Only this room imports h5py.
"""
