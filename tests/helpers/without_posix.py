"""Run commands of vibroimpact in a process without the features that only POSIX has.

    python without_posix.py [--one-block] COMMAND ARGUMENTS... [-- COMMAND ARGUMENTS...]...

With ``--one-block`` a run writes one block, and then waits until it is killed.
The libraries are imported first, because they have separate code for other systems. As on
Windows, an open file cannot be replaced or removed, and a folder cannot be opened. Nothing else
of another system is simulated.
"""

import builtins
import importlib
import os
import pathlib
import sys
import time
import types

LIBRARIES = (
    "dask.base filelock h5netcdf numba pandas platformdirs.unix psutil scipy.optimize xarray"
)
#: Libraries used only by these commands and options, which take long to import.
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
    """Remove features that other systems lack, and refuse calls that they refuse."""
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
    """Return an `open` without the paths of open descriptors, such as /dev/fd."""

    def open_file(file, *arguments, **options):
        if isinstance(file, str) and file.startswith(("/dev/fd", "/proc/self/fd")):
            raise FileNotFoundError(2, "No such file or directory", file)
        return function(file, *arguments, **options)

    return open_file


def refusing_open_files(function):
    """Return a function of `os` that refuses files which this process has open or mapped."""

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
        except FileNotFoundError:  # the descriptor of the listing itself
            continue
    with open("/proc/self/maps") as maps:
        paths.update(line.split(maxsplit=5)[-1].strip() for line in maps)
    return paths


def wait_after_one_block():
    """Let a run write one block, and then wait for longer than any test."""
    from sweeps.store.writer import SweepWriter

    write = SweepWriter.write

    def write_one(self, block, results):
        write(self, block, results)
        time.sleep(1e5)

    SweepWriter.write = write_one


def main(words):
    """Run the commands until one ends with a nonzero exit code."""
    take_away(words)
    if words[0] == "--one-block":
        wait_after_one_block()
        words = words[1:]
    from sweeps import interrupts
    from sweeps.cli.__main__ import main as command

    while words:
        end = words.index("--") if "--" in words else len(words)
        sys.argv, words = ["vibroimpact", *words[:end]], words[end + 1 :]
        try:
            command()
        except SystemExit as done:
            if done.code:
                raise
        interrupts._came = False  # as in another process


if __name__ == "__main__":
    main(sys.argv[1:])
