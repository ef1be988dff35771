"""The command line: arguments and exit codes only.

``main.py`` has ``run`` and ``schema``, ``read.py`` the commands that read a file, ``bench.py`` the
measurements; ``environment.py`` and ``terminal.py`` are what surrounds a command. Nothing here is
for import: the program starts in ``__main__.py``.
"""
