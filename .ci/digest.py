"""Print the digest of the data of sweep files; end with 1 if they have different data."""

import hashlib
import sys

import sweeps


def digest_of(file: str) -> str:
    """Return a digest of the names and bits of all variables of a file."""
    digest = hashlib.sha256()
    with sweeps.open_sweep(file) as dataset:
        for name in sorted(map(str, dataset.variables)):
            digest.update(name.encode() + dataset[name].values.tobytes())
    return digest.hexdigest()


digests = {digest_of(file) for file in sys.argv[1:]}
print(*digests)
sys.exit(len(digests) != 1)
