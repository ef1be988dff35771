"""Tables as CSV files: whole or not at all."""

import pandas as pd
import pytest

from sweeps.analysis.tables import write_csv
from sweeps.errors import Failed


class Failing:
    def __str__(self):
        raise OSError(28, "No space left on device")


def test_a_table_is_written_whole_or_not_at_all(tmp_path):
    """A failure leaves what was there before, and nothing beside it."""
    path = tmp_path / "a.csv"
    write_csv(path, pd.DataFrame([[1, 2.5], ["x, y", ""]], columns=["a", "b"]))
    assert path.read_bytes() == b'a,b\n1,2.5\n"x, y",\n'
    with pytest.raises(Failed, match=r"a\.csv cannot be written: No space"):
        write_csv(path, pd.DataFrame({"a": [1, Failing()], "b": 2}))
    assert path.read_bytes().startswith(b"a,b\n1,2.5\n")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
