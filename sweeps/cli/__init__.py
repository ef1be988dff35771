"""The command line: arguments and exit codes only.

``main.py`` puts the commands together: ``begin.py`` has ``init`` and ``schema``, ``run.py``,
``zoom.py``, ``plot.py`` and ``explore.py`` one command each, ``read.py`` those that read a file,
``bench.py`` the measurements. ``options.py`` has the options that several commands share;
``environment.py`` checks the settings around a command, ``terminal.py`` prints. Nothing here is for
import: the program starts in ``__main__.py``.
"""
