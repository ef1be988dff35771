"""The errors of the package, all derived from `SweepError`."""


class SweepError(Exception):
    """The request could not be fulfilled; the text says why."""


class Refused(SweepError):  # noqa: N818 - the counterpart of Failed
    """The request is wrong and no work was started; a command exits with 2."""


class Failed(SweepError):  # noqa: N818 - the counterpart of Refused
    """The work was started but not completed; a command exits with 1."""


class ConfigError(Refused, ValueError):
    """A configuration is not valid.

    Examples
    --------
    >>> import sweeps
    >>> try:
    ...     sweeps.load_config({"oscillator": {"h": 0.1, "R": 0.8, "omega": "2.3 Hz", "f": 1}})
    ... except sweeps.ConfigError as error:
    ...     print(str(error).partition(";")[0])
    """


class StoreError(Refused):
    """A file is not a sweep file, or cannot be used as requested.

    Examples
    --------
    >>> import sweeps
    >>> try:
    ...     sweeps.open_sweep("missing.h5")
    ... except sweeps.StoreError as error:
    ...     print(error)
    missing.h5 does not exist
    """
