"""The command line: arguments and exit codes only.

``main.py`` puts the commands together, and has ``init`` and ``schema``; ``run.py``, ``zoom.py``,
``plot.py`` and ``explore.py`` have one command each, ``read.py`` those that read a file,
``bench.py`` the measurements. ``options.py`` has what they share. Nothing here is for
import: the program starts in ``__main__.py``.
"""
