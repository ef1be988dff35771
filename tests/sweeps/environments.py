"""Odd environments in which a command is run: variables of every library that it stands on."""

#: A number, a switch, a name or a path as nobody means them.
_NONSENSE = ("abc", "-1", "0", "99999999999", "")
_PLACES = ("/proc", "/dev/null/x", "/sys/deep/folder", "")

VARIABLES = {
    "NUMBA_NUM_THREADS": _NONSENSE,
    "NUMBA_THREADING_LAYER": ("nonsense", "tbb", "omp", "workqueue", "safe", "threadsafe", ""),
    "NUMBA_THREADING_LAYER_PRIORITY": ("nonsense", "tbb omp", "tbb omp workqueue"),
    "NUMBA_DISABLE_JIT": ("1", "abc", "0"),
    "NUMBA_OPT": ("abc", "9", "max", "0"),
    "NUMBA_CPU_NAME": ("generic", "nonsense"),
    "NUMBA_CPU_FEATURES": ("", "+nonsense", "+sse2"),
    "NUMBA_BOUNDSCHECK": ("1", "abc"),
    "NUMBA_CACHE_DIR": _PLACES,
    "NUMBA_CACHE_LOCATOR_CLASSES": ("nonsense", "os.path.nonsense"),
    "NUMBA_DEBUG_CACHE": ("1", "abc"),
    "NUMBA_FUNCTION_CACHE_SIZE": ("abc", "0"),
    "OMP_NUM_THREADS": ("abc", "-1", "0", "1"),
    "MKL_NUM_THREADS": ("abc",),
    "OPENBLAS_NUM_THREADS": ("abc", "99999"),
    "MPLBACKEND": ("nonsense", "TkAgg", ""),
    "MPLCONFIGDIR": _PLACES,
    "MATPLOTLIBRC": ("/nonexistent", "."),
    "HOME": _PLACES,
    "XDG_CACHE_HOME": _PLACES,
    "XDG_CONFIG_HOME": _PLACES,
    "TMPDIR": _PLACES,
    "PATH": ("", "/nonexistent"),
    "LANG": ("nonsense", "C", "tr_TR.UTF-8"),
    "LC_ALL": ("nonsense", "POSIX"),
    "PYTHONIOENCODING": ("ascii", "latin-1", "utf-16"),
    "PYTHONUTF8": ("0", "1"),
    "PYTHONOPTIMIZE": ("1", "2"),
    "PYTHONUNBUFFERED": ("1",),
    "PYTHONDEVMODE": ("1",),
    "PYTHONMALLOC": ("malloc",),
    "TERM": ("dumb", "nonsense", ""),
    "COLUMNS": ("abc", "0", "-1", "1"),
    "LINES": ("abc", "0"),
    "NO_COLOR": ("1",),
    "FORCE_COLOR": ("1", "abc"),
    "TZ": ("nonsense", ":/dev/null"),
    "HDF5_USE_FILE_LOCKING": ("FALSE", "nonsense"),
    "HDF5_PLUGIN_PATH": ("/nonexistent",),
    "HDF5_DISABLE_VERSION_CHECK": ("abc",),
    "TYPER_USE_RICH": ("0", "abc"),
    "DASK_CONFIG": ("/nonexistent", "/dev/null"),
    "OPENBLAS_CORETYPE": ("nonsense",),
    "MALLOC_ARENA_MAX": ("1",),
    "COMP_WORDS": ("nonsense",),
}

#: One variable each, as a pair.
ENVIRONMENTS = [(name, value) for name, values in VARIABLES.items() for value in values]
