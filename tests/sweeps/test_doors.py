"""Wrong arguments and partial files at every public function: one refusal, in common words."""

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import sweeps
from sweeps import Refused, open_sweep, plotting
from sweeps.opened.doors import takes_sweep
from sweeps.plotting import Page

FILES = {
    "map": """
oscillator: {h: 0.1, R: [0.7, 0.8], omega: {start: 2.6, stop: 2.7, num: 4}, f: 1.0}
record: {transient: 50, periods: 32, diagnostics: [period]}
""",
    "starts": """
oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}
start: {x0: {start: -3, stop: 0.5, num: 4}, v0: {start: -3, stop: 3, num: 4}}
record: {transient: 100, periods: 32, diagnostics: [period]}
""",
}
SCENE = {"oscillator": {"h": 0.1, "R": 0.8, "omega": [2.5, 2.6], "f": 1.0}}


#: The functions of an opened sweep, and one that each of them takes.
DOORS = {
    "attractors": (sweeps.attractors, "starts"),
    "bifurcations": (sweeps.bifurcations, "map"),
    "branches": (sweeps.branches, "map"),
    "curves": (sweeps.curves, "map"),
    "integrity": (sweeps.integrity, "starts"),
    "knocks": (sweeps.knocks, "starts"),
    "plot": (lambda dataset, **options: plotting.plot(dataset, "a.png", **options), "map"),
    "bifurcation": (plotting.bifurcation, "map"),
    "section": (plotting.section, "map"),
    "impacts": (plotting.impacts, "map"),
    "trajectory": (plotting.trajectory, "map"),
    "animate": (plotting.animate, "map"),
    "parameter_map": (plotting.parameter_map, "map"),
    "basins": (plotting.basins, "starts"),
    "attractor_diagram": (plotting.attractor_diagram, "map"),
    "plotting.integrity": (plotting.integrity, "starts"),
    "table_panels": (plotting.table_panels, "map"),
}
#: What is no opened sweep, made of one.
NO_SWEEP = {
    "None": lambda _: None,
    "a number": lambda _: 3,
    "a dict": lambda ds: dict(ds),
    "an array": lambda ds: ds["status"],
    "another Dataset": lambda _: xr.Dataset({"a": ("b", [1.0])}),
    "no attributes": lambda ds: ds.drop_attrs(),
    "renamed": lambda ds: ds.rename({str(ds["status"].dims[0]): "w"}),
    "results renamed": lambda ds: ds.rename(status="outcome"),
    "averaged": lambda ds: ds.mean(str(ds["status"].dims[0]), keep_attrs=True),
    "no coordinate": lambda ds: ds.drop_vars(str(ds["status"].dims[0])),
    "empty": lambda ds: ds.isel({str(ds["status"].dims[0]): slice(0, 0)}),
    "stacked": lambda ds: ds.stack(both=[*map(str, ds["status"].dims)]),
    "of two sweeps": lambda ds: ds.assign_coords(h=ds[ds["status"].dims[1]] * 0.0 + [0, 1, 1, 1]),
    "a diagonal": lambda ds: ds.isel(
        dict.fromkeys(ds["status"].dims, xr.DataArray([0, 1], dims=ds["status"].dims[0]))
    ),
    "a parameter in words": lambda ds: ds.assign_coords(h="high"),
    "a parameter below its least": lambda ds: ds.assign_coords(h=-1.0),
    "no parameter": lambda ds: ds.assign_coords(h=np.nan),
    "averaged numbers": lambda ds: ds.assign(period=ds["period"] * 0.4),
    "words": lambda ds: ds.assign(status=ds["status"].astype(str)),
    "masks": lambda ds: ds.assign(status=ds["status"] > 0),
    "no sections": lambda ds: ds.isel(section=slice(0, 0)),
    "another outcome": lambda ds: ds.assign(status=ds["status"] + 99),
    "no impacts": lambda ds: ds.isel(impact=slice(0, 0)),
    "every other section": lambda ds: ds.isel(section=slice(None, None, 2)),
    "sections in reverse": lambda ds: ds.isel(section=slice(None, None, -1)),
    "every other impact": lambda ds: ds.isel(impact=slice(None, None, 2)),
    "the lesser exponent": lambda ds: ds.assign_coords(exponent=[1]),
    "too large integers": lambda ds: ds.assign(period=ds["period"] * 1e300),
    "results in words": lambda ds: ds.assign(poincare_x=ds["poincare_x"].astype(str)),
}


@pytest.mark.parametrize(
    ("door", "wrong"),
    [*product(DOORS, ("a number", "renamed")), *product(["curves"], NO_SWEEP)],
)
def test_only_an_opened_sweep_is_taken(loaded, door, wrong):
    function, name = DOORS[door]
    way_out = r"take isel\(\w+=slice\(-8, None\)\)" if "every other" in wrong else ""
    with pytest.raises(Refused, match=rf"{way_out}(; expected: an opened sweep|has no value of)"):
        function(NO_SWEEP[wrong](loaded[name]))


@pytest.mark.slow
@pytest.mark.parametrize("door", ["attractors", "bifurcations", "section"])
def test_a_path_is_opened(files, loaded, door):
    function, name = DOORS[door]
    for path in (files / f"{name}.h5", str(files / f"{name}.h5")):
        found, expected = function(path), function(loaded[name])
        if isinstance(found, Figure):
            assert found.get_suptitle() == expected.get_suptitle()
        else:
            assert found.equals(expected)
    with pytest.raises(sweeps.StoreError, match=r"missing\.h5 does not exist"):
        function("missing.h5")


def _refusal(door, dataset):
    """Return what a function says of a Dataset that lacks something; empty if it takes it."""
    try:
        DOORS[door][0](dataset)
    except Refused as refusal:
        return str(refusal)
    return ""


#: Functions that take no part of the files, or only begin to draw.
_OTHER_FILES = ("table_panels", "animate")


@pytest.mark.parametrize("door", [door for door in DOORS if door not in _OTHER_FILES])
def test_what_a_dataset_lacks_is_named_until_it_has_it(loaded, no_knocks, unpainted, door):
    """Each refusal names a variable; with those that were named the function does its work."""
    whole = loaded[DOORS[door][1]]
    has = {"status"}
    while text := _refusal(door, whole[[*has]]):
        named = re.search(
            r"has no (\w+).*?(its whole Dataset, or )?run the sweep again( with)?", text
        )
        assert named and bool(named[2]) != bool(named[3]), text
        assert named[1] not in has
        has.add(named[1])
    for name in has - {"status"} if whole is loaded["map"] else ():  # and all others are there
        text = _refusal(door, whole.drop_vars(name))
        assert not text or f"no {name}" in text, text


def test_what_exact_orbits_and_attractors_lack_is_named(loaded):
    over_map, starts = loaded["map"], loaded["starts"]
    branches, curves = sweeps.branches(over_map, "omega"), sweeps.curves(over_map)
    with pytest.raises(Refused, match=r"branches are at R = 0\.7, not 0\.8: find them there"):
        plotting.bifurcation(over_map, at={"R": 0.8}, exact=branches)
    for near, axis in ((1e-17, [0.0]), (1e-10, [0.0, 0.8])):  # of another linspace
        at_zero = over_map.isel(R=slice(len(axis))).assign_coords(R=axis)
        plotting.bifurcation(at_zero, axes="omega", exact=branches.assign_attrs(R=near))
    for name in ("branch", "m", "q", "stable", "poincare_x"):
        with pytest.raises(Refused, match=f"have no {name}: find them again"):
            plotting.bifurcation(over_map, exact=branches.drop_vars(name))
    for name in ("curve", "m", "q", "special"):
        with pytest.raises(Refused, match=f"exact curves have no {name}: find them again"):
            plotting.parameter_map(over_map, exact=curves.drop_vars(name))
    for name in ("m", "q", "section_x", "section_v"):
        with pytest.raises(Refused, match=r"found = .*expected: the result of sweeps\.attractors"):
            sweeps.knocks(starts, sweeps.attractors(starts).drop_vars(name))


def test_a_part_of_exact_orbits_is_drawn(loaded):
    """`where` makes floats of integers, and without ``drop`` leaves points without values."""
    over_map = loaded["map"]
    for draw, orbits in (
        (plotting.bifurcation, sweeps.branches(over_map, "omega")),
        (plotting.parameter_map, sweeps.curves(over_map)),
    ):
        chosen = orbits["m"] == 1
        parts = [orbits.isel(point=chosen.values), orbits.where(chosen)]
        parts.append(orbits.where(chosen, drop=True))
        if "stable" in orbits:
            parts[-1]["stable"] = parts[-1]["stable"].astype(float)  # as other programs have it
        drawn = [
            [[*map(str, line.get_xdata())] for line in draw(over_map, exact=part).findobj(Line2D)]
            for part in parts
        ]
        assert chosen.any() and drawn[0] == drawn[1] == drawn[2]


ITS_OWN = object()  # stands for the sweep itself
#: Wrong values of each argument, and the functions that have it.
WRONG = {
    "at": (
        ("R=0.8", 3, ["R"], {"R": None}, {"R": [0.7]}, {"R": "0.7"}, {3: 0.7}, {"R": np.nan}),
        "bifurcations branches curves plot bifurcation basins section",
    ),
    "axis": ((3, ["omega"], ("R", "omega")), "bifurcations branches"),
    "classes": (
        (["1/1"], "1/1", (1, 1), [(1,)], [(0, 1)], [(1, -1)], [(1.5, 1)], 3, [None]),
        "branches curves",
    ),
    "most": ((0, -1, 1.5, "2", None, True), "branches"),
    "kinds": ((3, [3], None), "curves"),
    "axes": ((3, [3]), "curves bifurcation parameter_map plot"),
    "page": ((None, "3.4in", 3.4, {"width": 3.4}), "bifurcation section trajectory basins plot"),
    "ax": ((3, "left", Figure()), "bifurcation section trajectory"),
    "exact": ((3, True, "1/1", ITS_OWN), "bifurcation parameter_map"),
    "coordinate": ((3, ["impact_v"]), "bifurcation"),
    "below": ((3, [3], {"a": 1}), "bifurcation"),
    "color": ((3, ["period"], np.ones(4)), "bifurcation"),
    "quantity": ((3, ["period"], np.ones(4)), "parameter_map"),
    "periods": ((0, -1, "4", 1.5, 10**12, True), "trajectory"),
    "kind": ((3, ["map"]), "plot"),
    "colour": (("period",), "plot"),
    "tolerance": ((-1.0, "1e-3", None, np.nan), "attractors"),
    "extensions": ((-1, 1.5, "2", None), "attractors"),
    "found": ((3, ITS_OWN, {}), "knocks"),
    "numbers": ((3, "0", ["0"], [1.5]), "knocks"),
}


def calls():
    """Yield an argument, a function and a wrong value: each one once, and one at each function."""
    for argument, (values, doors) in WRONG.items():
        first, *others = doors.split()
        for door, wrong in [*product([first], values), *product(others, values[:1])]:
            yield argument, door, {argument: wrong}


@pytest.mark.parametrize(("argument", "door", "options"), list(calls()))
def test_a_wrong_argument_of_an_opened_sweep_is_named(loaded, argument, door, options):
    function, name = DOORS[door]
    options = {key: loaded[name] if of is ITS_OWN else of for key, of in options.items()}
    with pytest.raises(Refused, match=rf"\b{argument}\b.*(expected: |choose |did you mean)"):
        function(loaded[name], **options)


@pytest.mark.parametrize("door", [door for door in DOORS if door not in ("plot", "animate")])
def test_an_argument_that_a_function_lacks_is_named(loaded, door):
    function, name = DOORS[door]
    with pytest.raises(Refused, match=r"^\w+: .*'at_'; expected: \w+(, \w+)*$"):
        function(loaded[name], at_={"R": 0.7})
    with pytest.raises(Refused, match=r"^\w+: missing .*; expected: \w+(, \w+)*$"):
        function()


RUN = [
    *(("threads", {"threads": n}) for n in (0, "2", 1.5, True, 10**6)),
    *(("client", {"client": client}) for client in (3, "tcp://127.0.0.1:8786")),
    *((name, {name: value}) for name in ("overwrite", "resume", "progress") for value in ("no", 1)),
    *(("output", {"output": output}) for output in (3, b"a.h5", ["a.h5"])),
    ("overwrite", {"overwrite": True, "resume": True}),
]


@pytest.mark.parametrize(("argument", "options"), RUN)
def test_a_wrong_argument_of_a_run_is_named(argument, options):
    with pytest.raises(Refused, match=rf"\b{argument}\b.*(expected: |exclude each other)"):
        sweeps.run_sweep(SCENE, **{"output": "a.h5", **options})
    assert not [path for path in Path().iterdir() if path.name != "sweep.yaml"]


OTHERS = [
    *(("the configuration", lambda x=x: sweeps.run_sweep(x)) for x in (None, 3)),
    *(("path", lambda x=x: sweeps.open_sweep(x)) for x in (None, 3, ["a.h5"], SCENE)),
    *(("verify", lambda x=x: sweeps.open_sweep("a.h5", verify=x)) for x in ("no", None)),
    *(("the configuration", lambda x=x: sweeps.explore(x)) for x in (None, 3)),
    *(("port", lambda x=x: sweeps.explore(SCENE, port=x)) for x in (-1, "80", 10**6, None)),
    *(("folder", lambda x=x: sweeps.explore(SCENE, folder=x)) for x in (3, "missing")),
    *(("width", lambda x=x: Page(width=x)) for x in ("3.4in", 0, -1, 0.5, 100, np.nan, True)),
    *(("height", lambda x=x: Page(height=x)) for x in ("2in", 0.5)),
    *(("dpi", lambda x=x: Page(dpi=x)) for x in (0, "300", 1.5)),
    *(("title", lambda x=x: Page(title=x)) for x in (3, ["a"])),
    *(("xlim", lambda x=x: Page(xlim=x)) for x in ("2:3", (3, 2), (1,), 3, (1, np.nan), "23")),
    *(("ylim", lambda x=x: Page(ylim=x)) for x in ((1, 1), ("1", "2"))),
]


@pytest.mark.parametrize(("argument", "function"), OTHERS)
def test_a_wrong_argument_is_named(argument, function):
    with pytest.raises(Refused, match=rf"\b{argument}\b.*expected: "):
        function()


def test_the_output_of_a_picture_is_a_path(loaded):
    for output in (3, None, ["a.png"]):
        with pytest.raises(Refused, match=r"output = .*expected: "):
            plotting.plot(loaded["map"], output)


def test_a_dataset_that_xarray_has_rearranged_is_the_same_sweep(loaded):
    ds = loaded["map"]
    seen = takes_sweep({})(lambda sweep: sweep.data)
    assert seen(ds.transpose("section", "impact", ...)).identical(ds)
    turned = ds.transpose(..., "R")
    assert [str(dim) for dim in seen(turned)["poincare_x"].dims] == ["omega", "R", "section"]
    (line, *_), (same, *_) = (
        plotting.bifurcation(data, axes="omega").axes[0].lines for data in (ds, turned)
    )
    np.testing.assert_array_equal(line.get_xydata(), same.get_xydata())


def test_a_sweep_followed_both_ways_is_transposed_but_does_not_lose_its_ways():
    """xarray fails at a single value of a transposed variable that is not read yet."""
    scene = {"follow": {"axis": "omega", "direction": "both"}, "record": {"transient": 0}}
    scene["oscillator"] = SCENE["oscillator"] | {"omega": [2.5, 2.6, 2.7]}
    ds = open_sweep(sweeps.run_sweep(scene, "both.h5"))
    for draw, at in ((plotting.bifurcation, {}), (plotting.section, {"direction": "down"})):
        figure, same = (draw(data, at=at) for data in (ds, ds.transpose("omega", ...)))
        assert figure.get_suptitle() == same.get_suptitle()
        drawn = [
            [line.get_xydata().tolist() for line in each.axes[0].lines] for each in (figure, same)
        ]
        assert str(drawn[0]) == str(drawn[1])
    assert "followed down along" in plotting.section(ds.isel(direction=1)).get_suptitle()
    with pytest.raises(Refused, match="has no coordinate direction"):
        plotting.section(ds.isel(direction=1, drop=True))


#: What other programs and calculations make of a Dataset.
SAME = {
    "attributes lost": lambda ds: ds.drop_attrs().assign_attrs(ds.attrs),
    "other types": lambda ds: ds.assign({n: v.astype("u8") for n, v in ds.items() if n != "status"
                                         and v.dtype.kind == "i" and (v >= 0).all()}),
    "other floats": lambda ds: ds.assign_coords(omega=ds["omega"].astype("g")).assign(
                                    {n: v.astype("g") for n, v in ds.items() if v.dtype == "f8"}),
    "objects": lambda ds: ds.assign_coords(section=ds["section"].astype(object)),
    "an axis anew": lambda ds: ds.assign_coords(omega=ds["omega"].values),
    "something empty": lambda ds: ds.assign(own=("trial", [])),
}  # fmt: skip


def labels_of(dataset):
    return [(ax.get_xlabel(), ax.get_ylabel()) for ax in plotting.parameter_map(dataset).axes]


@pytest.fixture(scope="module")
def labels(loaded):
    return labels_of(loaded["map"])


@pytest.mark.parametrize("change", SAME)
def test_attributes_and_types_are_those_of_a_file(loaded, labels, change):
    ds = loaded["map"]
    other = SAME[change](ds)
    before = other.copy()
    assert labels_of(other) == labels
    held = takes_sweep({})(lambda sweep: sweep.data)(other)
    assert all(held[name].dtype == values.dtype for name, values in ds.variables.items())
    assert other.identical(before)


def test_an_attribute_of_a_users_own_is_shown(loaded):
    ds = loaded["map"]
    own = ds.assign_coords(omega=ds["omega"].assign_attrs(long_name="speed"))
    assert labels_of(own)[0][0].startswith("speed ")


def test_the_attractors_of_an_axis_that_repeats_values_are_drawn(loaded):
    twice = xr.concat([loaded["map"], loaded["map"]], "R")
    figures = [plotting.attractor_diagram(ds, axes="omega") for ds in (loaded["map"], twice)]
    (points, *_), (same, *_) = (figure.axes[0].lines for figure in figures)
    np.testing.assert_array_equal(points.get_xydata(), same.get_xydata())


def test_a_column_of_a_table_may_be_left_out():
    table = {"omega": [2.3, 2.5, 2.4], "R": [0.7, 0.8, 0.75], "part": ["a", "b", "c"]}
    path = sweeps.run_sweep({"oscillator": {"h": 0.1, "f": 1.0}, "points": table}, "table.h5")
    with open_sweep(path) as ds:
        plotting.table_panels(ds.drop_vars("part"))
        with pytest.raises(Refused, match="has no coordinate R"):
            plotting.table_panels(ds.drop_vars("R"))


def test_a_column_of_a_table_may_be_called_like_a_result_of_attractors():
    starts = {"omega": [2.6, 2.6], "x0": [0.0, -1.0]}
    numbers = {key: [7, 8] for key in ("m", "number", "attractor", "coexisting", "set")}
    record = {"transient": 50, "periods": 32, "diagnostics": ["period"]}
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "f": 1.0}, "record": record}
    plain, named = (
        sweeps.attractors(sweeps.run_sweep(scene | {"points": points}, f"{len(points)}.h5"))
        for points in (starts, starts | numbers)
    )
    for name, values in plain.data_vars.items():
        np.testing.assert_array_equal(named[name], values)


def test_points_that_were_left_out_are_pending(loaded):
    ds = loaded["map"]
    left = ds.where(ds["omega"] > 2.65)
    assert left["status"].dtype.kind == "f"  # as xarray does it
    for name in ("status", "period", "class_evidence"):
        values = takes_sweep({})(lambda sweep: sweep.data)(left)[name]
        assert values.dtype == ds[name].dtype
        np.testing.assert_array_equal(values, np.where(ds["omega"] > 2.65, ds[name], -1))
    plotting.parameter_map(left)
    pending = sweeps.bifurcations(left, "omega", {"R": 0.7}).attrs["unclassified"]
    assert pending == (ds["omega"] <= 2.65).sum()
    with pytest.raises(Refused, match=r"the Dataset has numbers in \w+ that are no integers"):
        plotting.parameter_map((ds * 0.3).assign_attrs(ds.attrs))
