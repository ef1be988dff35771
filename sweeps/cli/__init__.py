"""The commands: arguments, names of outputs, exit codes.

``main.py`` assembles the commands and defines ``init``, ``schema`` and ``bench``. ``run.py``
defines ``run`` and ``explore``, ``zoom.py`` and ``plot.py`` one command each, ``read.py`` the
commands that read a sweep file. ``options.py`` has their common options. The program starts in
``__main__.py``; no module here is meant to be imported by users.
"""
