"""Any text given as a configuration is run or refused with a message, and leaves no files."""

import random
from pathlib import Path

import numpy as np
import pytest
import yaml

from sweeps.config.loading import load_config
from sweeps.errors import ConfigError
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.commands import call
from tests.helpers.odd_inputs import FOLLOWED, FULL, TABLES, damaged, document
from vibroimpact.status import Status


def answered(text):
    """Run a configuration dry, and return the exit code."""
    Path("fuzz.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
    result = call("run", "fuzz.yaml", "--dry-run")
    assert result.exit_code in (0, 2), result.output
    assert isinstance(result.exception, (SystemExit, type(None)))
    assert "Traceback" not in result.output
    assert result.exit_code == 0 or result.stderr.startswith("vibroimpact: error: ")
    assert [path.name for path in Path().iterdir()] == ["fuzz.yaml"]
    return result.exit_code


def run_and_checked(text):
    """Run a small accepted configuration; the file is complete and as configured."""
    config = load_config("fuzz.yaml")
    periods = config.size * (config.record.transient + config.record.periods)
    if periods * config.method.steps_per_period > 300_000:
        return False
    result = call("run", "fuzz.yaml", "--quiet", "--threads", "1")
    assert result.exit_code == 0, result.output
    assert result.output == ""
    with open_sweep(config.output) as dataset:
        dataset.load()
    assert dataset.attrs["name"] == config.name
    for name, values in config.sweep.grid.axes.items() if config.points is None else ():
        np.testing.assert_array_equal(dataset[name], values)
    assert (dataset["status"] != Status.PENDING).all()
    return True


#: Few enough points to be run.
DOCUMENTS = [yaml.safe_load(FULL), yaml.safe_load(FOLLOWED), *TABLES]


def answer_mutated(seed):
    """Check the configuration of a seed, run it if it is small, and leave no files."""
    rng = random.Random(seed)
    text = yaml.safe_dump(document(rng, DOCUMENTS))
    text = damaged(rng, text) if seed % 5 == 4 else text
    Path("fuzz.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        try:
            load_config("fuzz.yaml")
        except ConfigError as refusal:
            assert all(line.startswith("fuzz.yaml") for line in str(refusal).splitlines())
            return "refused"
        if answered(text) == 2:
            return "refused"
        return "run" if run_and_checked(text) else "accepted"
    except BaseException:
        print(f"seed {seed}:\n{text}")
        raise
    finally:
        for path in Path().iterdir():
            path.unlink()


STARTS = range(0, 10_000, 500)
MANY = [pytest.param(range(n, n + 500), marks=pytest.mark.campaign) for n in STARTS]


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(20), *MANY])
def test_a_mutated_configuration_is_answered(seeds):
    assert {answer_mutated(seed) for seed in seeds} >= {"refused", "run"}


def test_a_device_is_no_configuration():
    with pytest.raises(ConfigError, match="longer than"):
        load_config("/dev/zero")
