"""The file of a sweep: its content, and how it is created, verified and read.

Only this room imports h5py.
"""

import vibroimpact  # noqa: F401 - in a ZIP it says what to do
