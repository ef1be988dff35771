"""Run commands of vibroimpact in a process that lacks what only POSIX has.

    python without_posix.py COMMAND ARGUMENTS... [-- COMMAND ARGUMENTS...]...

The libraries are imported before, since they have ways of their own on other systems. As on
Windows, a file that is open cannot be replaced or removed, and a folder cannot be opened. What
this simulates is no more than that: no other system is run.
"""

import builtins
import importlib
import os
import pathlib
import sys
import types

LIBRARIES = "filelock h5netcdf numba pandas platformdirs.unix psutil scipy.optimize xarray"
#: Those that only these commands and options use, and that take long to import.
MORE = {
    "plot": "matplotlib.pyplot",
    "explore": "bokeh.server.server matplotlib.pyplot",
    "--dask": "distributed",
}
LACKING = {
    "os": "pread pwrite posix_fallocate fdatasync geteuid getuid fchmod O_NOFOLLOW O_NONBLOCK fork",
    "signal": "SIGKILL SIGPIPE SIGHUP pthread_sigmask setitimer",
}


def take_away(words):
    """Remove what other systems lack, and refuse what they refuse."""
    more = " ".join(names for word, names in MORE.items() if word in words)
    for library in f"{LIBRARIES} {more}".split():
        importlib.import_module(library)
    for name, lacking in LACKING.items():
        whole = sys.modules[name]
        less = {key: value for key, value in vars(whole).items() if key not in lacking.split()}
        sys.modules[name] = types.ModuleType(name)
        vars(sys.modules[name]).update(less)
    for name in ("fcntl", "resource", "pwd", "grp", "termios"):
        sys.modules[name] = None
    windows = pathlib.os = sys.modules["os"]
    for name in ("replace", "rename", "unlink", "remove"):
        setattr(windows, name, refusing_open_files(getattr(os, name)))
    windows.open = no_folder
    builtins.open = no_descriptors(builtins.open)


def no_folder(path, *arguments, **options):
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied", path)
    return os.open(path, *arguments, **options)


def no_descriptors(function):
    """Return an `open` that has no names for what is open already."""

    def open_file(file, *arguments, **options):
        if isinstance(file, str) and file.startswith(("/dev/fd", "/proc/self/fd")):
            raise FileNotFoundError(2, "No such file or directory", file)
        return function(file, *arguments, **options)

    return open_file


def refusing_open_files(function):
    """Return a function of `os` that refuses files that this process has open or mapped."""

    def refuse(*paths, **options):
        for path in map(os.path.realpath, paths):
            if os.path.isfile(path) and path in open_files():
                raise PermissionError(13, "the file is used by another process", path)
        return function(*paths, **options)

    return refuse


def open_files():
    """Return the paths of the files that this process has open or mapped."""
    paths = set()
    for descriptor in os.listdir("/proc/self/fd"):
        try:
            paths.add(os.readlink(f"/proc/self/fd/{descriptor}"))
        except FileNotFoundError:  # that of the listing
            continue
    with open("/proc/self/maps") as maps:
        paths.update(line.split(maxsplit=5)[-1].strip() for line in maps)
    return paths


def main(words):
    """Run each command, until one does not end with 0."""
    take_away(words)
    from sweeps.cli.__main__ import main as command

    while words:
        end = words.index("--") if "--" in words else len(words)
        sys.argv, words = ["vibroimpact", *words[:end]], words[end + 1 :]
        try:
            command()
        except SystemExit as done:
            if done.code:
                raise


if __name__ == "__main__":
    main(sys.argv[1:])
