"""Every error, as one tree. The text of an error is one paragraph."""


class SweepError(Exception):
    """What was asked for was not done; the text says why."""


class Refused(SweepError):  # noqa: N818 - the counterpart of Failed
    """The request is wrong, and nothing was begun; a command exits with 2."""


class Failed(SweepError):  # noqa: N818 - the counterpart of Refused
    """The work was begun and did not reach its end; a command exits with 1."""


class ConfigError(Refused, ValueError):
    """A configuration is not valid."""


class StoreError(Refused):
    """A file is not the file of a sweep, or cannot be used as asked."""
