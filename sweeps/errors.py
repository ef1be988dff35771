"""The errors of the store."""


class StoreError(Exception):
    """A file cannot be used as asked; the text is one paragraph for the user."""


class StoreFailure(StoreError):  # noqa: N818 - it tells a failure from a refusal
    """A file that was accepted cannot be written, say on a full disk."""


class ClusterError(Exception):
    """A cluster cannot be used as asked; the text is one paragraph for the user."""


class ClusterFailure(ClusterError):  # noqa: N818 - it tells a failure from a refusal
    """A cluster that was accepted failed in the middle of the work."""
