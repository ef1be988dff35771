"""Sweeps over a table: the same bits as a grid, bad tables, attractors."""

import itertools
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from numpy.testing import assert_array_equal

from sweeps import attractors, load_config, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_rows
from sweeps.config.groups import STARTS
from sweeps.errors import ConfigError, StoreError
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.commands import accepted, refused
from tests.helpers.configurations import load

FIXED_R = "oscillator: {h: 0.05, R: 0.8, f: 1.0}"
FIXED = "oscillator: {h: 0.05, f: 1.0}"
RECORD = "record: {transient: 30, periods: 8, impacts: 5, diagnostics: [period, lyapunov]}"
CONFIG = f"points: table.csv\n{FIXED}\n{RECORD}\n"
#: A grid, and the parameters that are the columns of its table.
GRIDS = {
    "plain": {"R": np.linspace(0.5, 0.9, 4), "omega": np.linspace(2.4, 3.5, 60)},
    "scaled": {"omega": np.linspace(2.4, 3.5, 20), "f": np.array([0.3, 1.0, 7.0])},
    "starts": {"v0": np.linspace(-0.5, 0.5, 5), "phase": np.linspace(0.0, 6.2, 20)},
}


def shuffled(axes):
    """Return the points of a grid in another order, and their positions in the grid."""
    columns = np.array(list(itertools.product(*axes.values()))).T
    order = np.random.default_rng(1).permutation(columns.shape[1])
    return dict(zip(axes, columns[:, order], strict=True)), order


def write_csv(columns, path="table.csv"):
    lines = [",".join(columns)]
    lines += [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIDS)
def test_a_table_of_a_grid_has_its_bits_in_any_order(name):
    axes = GRIDS[name]
    given = {"h": 0.05, "R": 0.8, "omega": 2.7, "f": 1.0}
    record = yaml.safe_load(RECORD)
    others = {key: value for key, value in given.items() if key not in axes}
    start = {key: values for key, values in axes.items() if key in STARTS}
    own = {key: values for key, values in axes.items() if key not in start}
    run_sweep({"oscillator": {**others, **own}, "start": start, **record}, "grid.h5")
    columns, order = shuffled(axes)
    write_csv({**columns, "label": [f"part {i}" for i in order], "serial": order})
    config = load({"points": "table.csv", "oscillator": others, **record})
    run_sweep(config, "table.h5")
    with open_sweep("grid.h5") as grid, open_sweep("table.h5") as table:
        assert table["status"].dims == ("point",)
        assert_array_equal(table["point"], np.arange(len(order)) + 1)
        assert_array_equal(table["serial"], order)
        assert list(table["label"].values) == [f"part {i}" for i in order]
        for axis, values in columns.items():
            assert_array_equal(table[axis], values)
        for variable in grid.data_vars:
            flat = grid[variable].values.reshape(len(order), -1)
            assert_array_equal(table[variable].values.reshape(len(order), -1), flat[order])
        assert table["omega"].attrs.get("units") == grid["omega"].attrs.get("units") is None
    plain = xr.open_dataset("table.h5", engine="h5netcdf")  # as in another program
    assert {*columns, "label", "serial"} <= {*plain.coords}
    plain.close()


@pytest.mark.slow
def test_a_table_goes_on_where_it_was_stopped(stop_after):
    """To the same bits; not with another table, or with the same table in another order."""
    columns, _ = shuffled(GRIDS["plain"])
    write_csv(columns)
    run_sweep("sweep.yaml", "whole.h5")
    with stop_after(3, size=20), pytest.raises(KeyboardInterrupt):
        run_sweep("sweep.yaml", "out.h5")
    with open_sweep("out.h5") as part:  # read from its blocks
        assert 0 < (part["status"] == -1).sum() < len(part["status"])
        assert_array_equal(part["omega"], columns["omega"])
    for other in (
        {name: values[::-1] for name, values in columns.items()},
        {**columns, "n": columns["R"]},
    ):
        write_csv(other)
        with pytest.raises(StoreError, match="other values or another order"):
            run_sweep("sweep.yaml", "out.h5", resume=True)
    write_csv(columns)
    run_sweep("sweep.yaml", "out.h5", resume=True)
    with open_sweep("out.h5") as out, open_sweep("whole.h5") as whole:
        xr.testing.assert_equal(out.load(), whole.load())


@pytest.mark.slow
def test_every_form_of_a_table_is_the_same_sweep():
    """A file, columns of YAML, arrays, a DataFrame, a structured array; and the file of a sweep."""
    columns = {"omega": [2.5, 0.1 + 0.2, 3.0], "R": [0.5, 1.0, 0.0], "label": ["a", "", "007"]}
    columns |= {"mm": [0.5, 2.0, -1.5], "class": ["b", "a", "c"]}  # its own, not the motion's
    write_csv(columns)
    frame = pd.DataFrame(columns)
    table = load_config("sweep.yaml").points
    forms = [columns, frame, table, {name: np.array(values) for name, values in columns.items()}]
    forms += [{**columns, "mm": np.array(columns["mm"], kind)} for kind in ("f2", "g", ">f8")]
    for form in forms:
        given = load_config({"points": form, **yaml.safe_load(f"{FIXED}\n{RECORD}")}).points
        assert given.dtype == table.dtype and (given == table).all()
    accepted("run", "sweep.yaml", "-o", "out.h5", "--quiet")
    Path("again.yaml").write_text(accepted("info", "out.h5", "--config"))
    Path("table.csv").unlink()  # the sweep file includes the table
    for source in ("again.yaml", "out.h5"):
        accepted("run", source, "-o", f"{source}.h5", "--quiet")
        with open_sweep("out.h5") as out, open_sweep(f"{source}.h5") as again:
            xr.testing.assert_equal(out.load(), again.load())
    accepted("run", "out.h5", "--resume", "--quiet")
    accepted("export", "out.h5", "-o", "rows.csv")
    exported = pd.read_csv("rows.csv", keep_default_na=False, dtype={"label": str})
    assert_array_equal(exported["omega"], columns["omega"])
    assert all(list(exported[name]) == columns[name] for name in ("label", "class"))
    assert list(exported["point"]) == [1, 2, 3]


def refused_table(text):
    Path("table.csv").write_bytes(text.encode())
    with pytest.raises(ConfigError) as error:
        load_config("sweep.yaml")
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("R,omega\n0.5,2\nabc,2\n", "table.csv: row 2, column R = abc is not allowed; expected"),
        ("R,omega\n0.5,2\n,\n", "row 2, column R = (nothing) is not allowed"),
        ("R,omega\n1_0,2\n", "row 1, column R = 1_0 is not allowed"),
        ('R,omega\n"0,5",2\n', "R = 0,5 is not allowed; expected: a number from 0 to 1, with a de"),
        ("R,omega\n0,5,2\n", "row 1 has 3 cells, and the header 2"),
        (pd.DataFrame({"omega": [2.5], "R": [0.8]}).to_csv(), "index=False"),
        ("omega;R\n2,5;0.8\n", "and commas between the columns"),
        ("R,omega,label\n0.5,2,a\n0.5,2\n", "row 2 has 2 cells, and the header 3"),
        ("", "the table is empty; expected: a header with one of h, R"),
        ("R,omga\n0.5,2\n", "unknown column omga (did you mean omega?)"),
        ("omga\n2\n", "no column of omga is a parameter (did you mean omega?); expected: a h"),
        ("R,omega,a/b\n0.5,2,1\n", "unknown column a/b; expected"),
        ("R,R\n0.5,2\n", "column R is given twice; expected: once"),
        ('R,note\n0.5,a\n0.6,"b\n0.7,c\n', "row 2, column note: a quote is not closed; expected:"),
        ('R,omega\n\n"0.5,2\n0.6,2\n', "row 1, column R: a quote is not closed"),
        ('R,"omega\n0.5,2\n', "a quote in the header is not closed"),
        ("R,note\n0.5,a\n0.5,b\0c\n", r"row 2, column note = b\x00c is not allowed"),
        ("R,omega\n", "the table has no row"),
        ("R,omega,h\n0.5,2,1\n", "oscillator.h: conflicts with points; expected: one number here"),
        ("R,omega,x0,clearance\n0.5,2,1,1\n0.5,2,2,1\n", "row 2 of points: x0 = 2 lies beyond"),
    ],
)  # fmt: skip
def test_a_bad_table_is_refused_by_row_and_column(text, part):
    assert part in refused_table(text)


def test_the_bytes_of_a_table_are_those_that_programs_write():
    """A BOM, Windows' line ends, empty lines, quotes, spaces and long serial numbers are read."""
    text = '\ufeffomega , R,serial\r\n2.5 ,"0.8",99999999999999999999\r\n\r\n1e-3,1,7\r\n\r\n'
    Path("table.csv").write_bytes(text.encode())
    table = load_config("sweep.yaml").points
    assert table.tolist() == [(2.5, 0.8, "99999999999999999999"), (1e-3, 1.0, "7")]
    Path("table.csv").write_bytes(b"R,omega\n\xff,1\n")
    with pytest.raises(ConfigError, match="the text is not in UTF-8; expected: a table saved"):
        load_config("sweep.yaml")
    for header in ("R," + "x" * 131_073 + ",omega\n0.5,1,2\n", "R" * 200_000):
        Path("table.csv").write_text(header)
        with pytest.raises(ConfigError, match=r"table\.csv: the header is longer than 100,000"):
            load_config("sweep.yaml")
    Path("table.csv").unlink()
    with pytest.raises(ConfigError, match=r"line 1: points: table\.csv does not exist"):
        load_config("sweep.yaml")


def test_texts_in_quotes_and_leading_zeros_are_kept():
    """A quote takes in commas, but no line; blank lines are skipped, before the header too."""
    text = '\n \nomega,label,number,part\n\n1,"a, ""b""",7,007\n  \n2,5" pipe,0.5,12\n'
    Path("table.csv").write_text(text)
    table = load_config("sweep.yaml", ["oscillator.R=0.5"]).points
    assert table.tolist() == [(1.0, 'a, "b"', 7.0, "007"), (2.0, '5" pipe', 0.5, "12")]
    given = load_config({"points": {"omega": [1], "part": ["-07"]}, **yaml.safe_load(FIXED_R)})
    assert given.points["part"].tolist() == ["-07"]


def test_a_table_that_is_too_wide_is_refused():
    """HDF5 has no room for more columns of one dimension."""
    table = f'R,note\n0.5,"{"x" * 140_000}"\n'
    assert "a cell with a quote has more than 131,072 c" in refused_table(table)
    assert "table.csv: 5,002 columns are too many; expected: at most 4,000" in refused_table(
        "R,omega" + "".join(f",c{i}" for i in range(5_000)) + "\n0.5,2\n"
    )


@pytest.mark.parametrize("place", ["there", "override"])
def test_the_file_of_a_table_lies_beside_the_configuration_or_where_the_command_is(place):
    Path(place).mkdir()
    write_csv({"R": [0.5], "omega": [2.0]}, f"{place}/table.csv")
    write_csv({"R": [0.5, 0.6], "omega": [2.0, 2.0]}, "other.csv")
    Path(f"{place}/sweep.yaml").write_text(CONFIG)
    assert load_config(f"{place}/sweep.yaml").size == 1
    assert load_config(f"{place}/sweep.yaml", ["points=other.csv"]).size == 2


@pytest.mark.parametrize(
    ("points", "part"),
    [
        ({"R": [0.5, 0.6], "omega": [2.0]}, "equal length; given: R of length 2, omega "),
        ({"R": 0.5}, "must be lists of equal length"),
        ([0.5, 0.6], "no table; expected: a CSV file, or a mapping of columns"),
        ({"R": [[0.5, 0.6], [0.7]]}, "must be lists of equal length"),
        ({"R": ["0.5", None]}, "row 2, column R = None is not allowed"),
        ({"R": [b"0.5"]}, "row 1, column R = b'0.5' is not allowed; expected: a number from 0"),
        ({"R": np.array([1], "m8[s]")}, "row 1, column R = 1 seconds is not allowed"),
        ({"R": np.ma.array([0.5, 0.6], mask=[0, 1])}, "row 2, column R is masked; expected: a val"),
        ({"R": [0.5], 7: [1], "7": [2]}, "column 7 is given twice"),
        (pd.DataFrame([[0.5, 0.6]], columns=["R", "R"]), "column R is given twice; expected: once"),
    ],
)  # fmt: skip
def test_columns_that_are_no_table_are_refused(points, part):
    with pytest.raises(ConfigError, match=part):
        load_config({"points": points, "oscillator": {"h": 0.1, "f": 1.0, "omega": 2.0}})


@pytest.mark.parametrize(
    "cells",
    [
        np.array([1], "m8[s]"), np.array([1], "M8[s]"), [b"a"], [{"a": 1}], ["a\0"], ["a\0b"],
        ["a\rb"], ["\ud800"], [None], [True], [1j], np.array([True], object),
        np.array([np.nan], object), np.array([np.timedelta64(1, "s")], object),
    ],
)  # fmt: skip
def test_a_further_column_holds_numbers_and_texts(cells):
    """Nothing else becomes a text or a number; CSV has a return as a new row, in Python 3.11."""
    points = {"omega": [2.0], "note": cells}
    hint = "" if isinstance(cells[0], str) else "; astype"
    with pytest.raises(
        ConfigError, match=rf"row 1, column note = .* a Unicode text .* return{hint}"
    ):
        load_config({"points": points, "oscillator": {"h": 0.1, "R": 0.8, "f": 1.0}})


@pytest.mark.parametrize("name", ["/dev/zero", "fifo", "."])
def test_only_a_regular_file_is_a_table(name):
    """A device never ends, and a FIFO waits for its writer."""
    if name == "fifo":
        os.mkfifo(name)
    said = "cannot be read" if name == "." else "is not a regular file; expected: a CSV file"
    with pytest.raises(ConfigError, match=said):
        load_config("sweep.yaml", [f"points={name}"])


def test_what_needs_an_axis_is_refused():
    write_csv({"R": [0.5], "omega": [2.0]})
    with pytest.raises(ConfigError, match="follow: needs an axis, but points has none"):
        load_config("sweep.yaml", ["follow.axis=omega"])


@pytest.mark.parametrize("name", ["status", "blocks", "point", "section", "lyapunov_2"])
def test_a_column_with_the_name_of_a_result_is_refused(name):
    write_csv({"R": [0.5], "omega": [2.0], name: [1]})
    for options in ([], ["--dry-run"]):
        said = refused("run", "sweep.yaml", *options)
        assert f"sweep.yaml: points: the column {name} has the name of a result" in said
    with pytest.raises(StoreError, match=f"the column {name} has the name of a result"):
        run_sweep("sweep.yaml", "nowhere/out.h5")  # before the output is looked at


@pytest.mark.slow
@pytest.mark.parametrize("omega", [(1.3,), (1.3, 1.5)])
def test_attractors_of_a_table_are_those_of_the_grid_of_its_starts(omega):
    starts = {"x0": np.linspace(-1.0, 0.0, 5), "v0": np.linspace(-1.0, 1.0, 4)}
    given = {"h": 0.0, "R": 0.8, "f": 1.0}
    record = {"record": {"transient": 300, "periods": 60}}
    run_sweep({"oscillator": {**given, "omega": list(omega)}, "start": starts, **record}, "grid.h5")
    points, _ = shuffled({"omega": np.array(omega), **starts})
    run_sweep({"points": points, "oscillator": given, **record}, "table.h5")
    found = []
    for name in ("grid.h5", "table.h5"):
        with open_sweep(name) as dataset:
            listed = attractor_rows(OpenedSweep(dataset), attractors(dataset))
        rows = ((row.parameters["omega"], row.name, row.fraction, row.speeds) for row in listed)
        found.append(sorted((*row, *speeds.round(9)) for *row, speeds in rows))
    assert found[0] == found[1] and len(found[0]) == 1 + len(omega)
