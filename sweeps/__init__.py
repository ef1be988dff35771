"""The sweep engine: a YAML configuration in, an HDF5 file and pictures out.

A sweep:

- `load_config`: read a configuration, a `SweepConfig`, from YAML or a mapping
- `run_sweep`: compute a sweep and write its file
- `open_sweep`: open a file as an xarray Dataset
- `explore`: show the diagram of a configuration in the browser

What is in an opened sweep:

- `attractors`: the attractors that the starts reach
- `bifurcations`: where the class of the motion changes along an axis, and why
- `branches`, `curves`: the periodic orbits along an axis, and their bifurcations over a map
- `integrity`, `knocks`: how large a disturbance each attractor takes
- `sweeps.plotting`: pictures

Errors: `Refused` if the request was wrong, with its kinds `ConfigError` and `StoreError`; `Failed`
if the work was started but not completed. ``help(sweeps.run_sweep)`` describes one of these names.
"""


def __getattr__(name: str) -> object:
    """Attach the names of ``__init__.pyi`` when the first one is used.

    A command imports this package before it can listen to signals, so it must import nothing else.
    """
    if name == "__all__":  # help(sweeps) would print the docstring of every name in it
        raise AttributeError(name)
    import lazy_loader

    from vibroimpact import __version__

    attribute, names, _ = lazy_loader.attach_stub(__name__, __file__)
    globals().update(__dir__=names, __version__=__version__)
    return __version__ if name == "__version__" else attribute(name)


def __dir__() -> list[str]:
    __getattr__("__version__")  # attaches the names
    return globals()["__dir__"]()  # type: ignore[no-any-return]
