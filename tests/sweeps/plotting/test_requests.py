"""Pictures as files, the default picture, and invalid requests."""

from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import sweeps
from sweeps import open_sweep, plotting, run_sweep
from sweeps.bifurcation.bifurcation_table import find_bifurcations
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import KINDS, api, bifurcation, parameter_map, plot, section, trajectory
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.written_files import FIXED, OMEGA, R, fill_blocks, planned
from vibroimpact.status import Status


@pytest.mark.parametrize("link", ["symbolic", "hard", "dotted"])
def test_the_data_are_never_replaced(random_sweep, tmp_path, link):
    dataset = random_sweep({"omega": OMEGA})
    data, picture = Path(dataset.encoding["source"]), tmp_path / "link.png"
    before = data.read_bytes()
    if link == "symbolic":
        picture.symlink_to(data)
    elif link == "hard":
        picture.hardlink_to(data)
    else:
        (data.parent / "folder").mkdir()
        picture = data.parent / "folder" / ".." / data.name
    with pytest.raises(Refused, match="would replace the data; give another output"):
        plot(dataset, picture)
    assert data.read_bytes() == before


@pytest.mark.slow
def test_a_picture_is_replaced_whole_or_not_at_all(random_sweep, tmp_path, monkeypatch):
    dataset = random_sweep({"omega": OMEGA})
    target, link = tmp_path / "a.png", tmp_path / "link.png"
    target.write_text("old")
    link.symlink_to("a.png")

    def fail(self, file, **_):
        file.write(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(api.Figure, "savefig", fail)
        plot(dataset, target)
    assert target.read_text() == "old"
    plot(dataset, link)
    assert link.is_symlink() and target.read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "link.png"]


def test_a_name_that_the_font_lacks_gives_no_warning(random_sweep, tmp_path):
    plot(random_sweep({"omega": OMEGA}, name="振動 衝突"), tmp_path / "a.png")


def test_powers_of_ten_are_set_as_such(random_sweep):
    dataset = random_sweep({"omega": OMEGA}, fixed={**FIXED, "clearance": 1e300, "f": 2.5e-7})
    figure = section(dataset)
    assert r"$f=2.5\times10^{-7}$" in figure.get_suptitle()
    assert r"$\sigma=1\times10^{300}$" in figure.get_suptitle()
    (legend,) = figure.legends
    assert r"\sigma=1\times10^{300}$" in legend.get_texts()[0].get_text()


@pytest.mark.parametrize(
    ("draw", "options", "is_drawn"),
    [
        (parameter_map, {}, True),
        (parameter_map, {"quantity": "clearance"}, True),
        (bifurcation, {"axes": ["clearance"]}, True),
        (section, {"at": {"clearance": 1.7e308}}, True),
        (trajectory, {"at": {"clearance": 1.7e308}}, True),
        (bifurcation, {"axes": ["omega"]}, False),
        (section, {"color": "omega", "at": {"clearance": 0.0}}, False),
    ],
)
def test_what_is_beyond_the_numbers_of_matplotlib_is_refused(random_sweep, draw, options, is_drawn):
    """Instead of a traceback of the search for ticks; one that is not drawn is not."""
    sweep = random_sweep({"clearance": [0.0, 1.7e308], "omega": OMEGA})
    if not is_drawn:
        assert isinstance(draw(sweep, **options), Figure)
    else:
        with pytest.raises(Refused, match=r"clearance reaches 1\.7e\+308; a picture shows up to"):
            draw(sweep, **options)


def test_a_map_over_too_many_decades_is_refused(random_sweep):
    with pytest.raises(Refused, match="a cell of clearance reaches inf; a picture shows up to"):
        parameter_map(random_sweep({"clearance": [1e-300, 1.0, 1e300], "omega": OMEGA}))


@pytest.mark.parametrize(
    ("axes", "with_trajectory", "expected"),
    [
        ({"omega": OMEGA}, True, "bifurcation"),
        ({}, True, "trajectory"),
        ({}, False, "section"),
        ({"R": R, "omega": OMEGA}, False, "map"),
        ({"f": [1.0], "omega": OMEGA}, False, "bifurcation"),
    ],
)
def test_the_default_kind(random_sweep, tmp_path, monkeypatch, axes, with_trajectory, expected):
    called = []
    monkeypatch.setattr(api.Kind, "draw", lambda kind, *_, **__: called.append(kind) or Figure())
    diagnostics = ["period"]
    sweep = random_sweep(axes, with_trajectory=with_trajectory, diagnostics=diagnostics)
    plot(sweep, tmp_path / "a.PDF")
    assert called == [KINDS[expected]] and (tmp_path / "a.PDF").read_bytes().startswith(b"%PDF")


def test_an_axis_of_one_value_is_no_choice(random_sweep, tmp_path):
    """It is not drawn: curves over it are refused, and nobody is told to take another value."""
    sweep = random_sweep({"f": [1.0], "omega": OMEGA})
    assert api.silent_cuts(OpenedSweep(sweep), "bifurcation") == {}
    assert api.silent_cuts(OpenedSweep(sweep), "section") == {"omega": OMEGA[0]}
    values = {"kind": ["graze"], "f": [1.0], "omega": [2.5]}
    curves = xr.Dataset({name: ("point", column) for name, column in values.items()})
    with pytest.raises(Refused, match="the exact curves, which a map shows, are over f, omega, no"):
        plot(sweep, tmp_path / "a.png", exact=curves.set_coords(["f", "omega"]))


@pytest.fixture(scope="module")
def without_impacts(random_sweep):
    return random_sweep({"R": R, "omega": OMEGA}, impacts=0, with_trajectory=False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"output": "a.jpg"}, r"a\.jpg must end in one of \.png, \.svg, \.pdf"),
        ({"output": "missing/a.png"}, r"the folder .*missing of the picture a\.png does not exist"),
        ({"output": "folder.png"}, r"folder\.png is a directory"),
        ({"kind": "bifurcaton"}, "no picture 'bifurcaton' .did you mean bifurcation.*choose"),
        ({"coordinate": ""}, "no '' to draw; choose from: poincare_x"),
        ({"axes": ["h"]}, "h is not a swept axis; the file has R, omega"),
        ({"at": {"h": 1.0}}, "h cannot be fixed here; choose from: R"),
        ({"axes": ["omega"], "at": {"omega": 1.0}}, "omega cannot be .* all its .*; choose .* R"),
        ({"at": {"R": 0.9}}, "R = 0.9 is outside the sweep: 0.5 to 0.8"),
        ({"coordinate": "status"}, "status is not a coordinate of the motion; choose from: poi"),
        ({"coordinate": "impact_v"}, "has no impact_v to draw; choose from: poincare_x, poin"),
        ({"coordinate": "peak_to_peak"}, r"follows from x_min.*record.diagnostics: \[extremes\]"),
        ({"kind": "section", "axes": ["R"]}, "for bifurcation or attractors or map or table only"),
        ({"kind": "section", "quantity": "period"}, "quantity can be chosen for map or table"),
        (
            {"kind": "impacts", "color": "period"},
            "has no impact_phase: run the sweep again with record.impacts: 64",
        ),
        ({"kind": "bifurcation", "quantity": "period"}, "a diagram shows it as color or below"),
        ({"axes": ["R", "omega"]}, "a bifurcation has 1 swept axis, not R, omega"),
        ({"coordinate": "max_penetration"}, "is not a coordinate .*; max_penetration can be drawn"),
        ({"below": ("status",)}, "status cannot be drawn below a diagram: its numbers stand for"),
        ({"below": ("rest_fraction",) * 2}, "rest_fraction is asked for twice"),
        ({"kind": "map", "below": ("rest_fraction",)}, "below can be chosen for bifurcation"),
        ({"below": ("rest_fracton",)}, "no rest_fracton .did you mean rest_fraction..; cho"),
        ({"color": "poincare_x"}, "poincare_x is not a number for each point; choose from: cha"),
        ({"kind": "basins", "color": "status"}, "color can be chosen for bifurcation or section"),
        ({"kind": "section", "color": "impulse", "at": {"R": 0.5, "omega": 1}}, "one point is "),
    ],
)
def test_requests_that_do_not_fit_are_refused(without_impacts, tmp_path, options, message):
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(Refused, match=message):
        plot(without_impacts, **{**options, "output": tmp_path / options.get("output", "a.png")})
    assert not (tmp_path / "a.png").exists()


NAMES_ALONE = [
    (bifurcation, "map", {"axes": "omega"}),
    (bifurcation, "map", {"below": "impulse"}),
    (plotting.table_panels, "table", {"axes": "omega"}),
    (plotting.table_panels, "table", {"panels": "x0"}),
    (sweeps.curves, "map", {"kinds": "flip"}),
]


def outcome(call, *arguments, **options):
    """Return the labels of a figure, the attributes of a Dataset, or the text of a refusal."""
    try:
        result = call(*arguments, **options)
    except Refused as error:
        return str(error)
    if isinstance(result, xr.Dataset):
        return result.attrs
    return [(panel.get_xlabel(), panel.get_ylabel()) for panel in result.axes]


@pytest.mark.parametrize(("call", "shape", "argument"), NAMES_ALONE)
def test_a_name_alone_means_that_name(files, call, shape, argument):
    """And not the names of its letters."""
    ((option, name),) = argument.items()
    with open_sweep(files / f"{shape}.h5") as dataset:
        alone = outcome(call, dataset, **argument)
        assert alone == outcome(call, dataset, **{option: [name]})
        if option == "kinds":
            assert alone == outcome(call, dataset, kinds={name})
        if option == "below" or (call == plotting.table_panels and option == "axes"):
            assert alone == outcome(call, dataset, **{option: dataset[name]})
        elif name in dataset and option != "panels":
            for values in (dataset[name], [dataset[name]]):
                assert "names of" in outcome(call, dataset, **{option: values})


@pytest.mark.parametrize("find", [sweeps.branches, sweeps.bifurcations, sweeps.curves])
def test_a_report_is_a_function(random_sweep, find):
    with pytest.raises(Refused, match=r"^report = .* is not allowed; expected: a function of"):
        find(random_sweep({"omega": OMEGA}), report="no")


def test_a_panel_below_needs_a_figure_of_its_own(random_sweep):
    with pytest.raises(Refused, match="leave out ax or below"):
        bifurcation(random_sweep({"omega": OMEGA}), below=["h"], ax=Figure().add_subplot())


def test_the_outermost_value_may_be_rounded(random_sweep):
    dataset = random_sweep({"R": [0.1 * 3, 0.1], "omega": OMEGA})
    assert "$R=0.3$" in section(dataset, at={"R": 0.3}).get_suptitle()


def test_a_single_point_has_no_bifurcation(random_sweep):
    with pytest.raises(Refused, match="a single point"):
        bifurcation(random_sweep({}))


def test_nothing_to_draw_is_said(random_sweep):
    nothing = np.full((4, 5), np.nan)
    pending = np.full(4, Status.PENDING, np.int8)
    dataset = random_sweep({"omega": OMEGA}, status=pending, poincare_x=nothing)
    with pytest.raises(Refused, match=r"no point has a result: not computed yet .4."):
        bifurcation(dataset)
    with pytest.raises(Refused, match="nothing to draw at this point: not computed yet"):
        section(dataset)


@pytest.mark.slow
def test_a_picture_is_over_the_axis_that_is_left(random_sweep):
    """Of equally long axes the first is drawn, unless it is fixed."""
    dataset = random_sweep({"R": R, "omega": [1.0, 2.0]}, diagnostics=("period",))
    over = {"R": "coefficient of restitution $R$", "omega": r"forcing frequency $\omega$"}
    for at, axis in (({}, "R"), ({"R": 0.8}, "omega"), ({"omega": 2.0}, "R")):
        assert bifurcation(dataset, at=at).axes[0].get_xlabel() == over[axis]
        assert find_bifurcations(OpenedSweep(dataset), at=at).attrs["axis"] == axis
    with pytest.raises(Refused, match="R cannot be fixed here: all its values are used; ch"):
        bifurcation(dataset, axes=["R"], at={"R": 0.8})
    cube = random_sweep({"R": R, "omega": [1.0, 2.0], "h": [0.1, 0.2]}, diagnostics=("period",))
    (panel,) = parameter_map(cube, at={"R": 0.8}).axes
    assert panel.get_ylabel() == over["omega"] and "damping" in panel.get_xlabel()


# Files of every shape, also those of which no block is finished

RECORD = "record: {transient: 20, periods: 4, impacts: 4}\n"
FIXED_OSCILLATOR = "oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}\n"
STARTS = "start: {x0: {start: -3, stop: 0.5, num: 3}, v0: {start: -3, stop: 3, num: 3}}\n"
SHAPES = {
    "point": FIXED_OSCILLATOR,
    "map": "oscillator: {h: 0.1, R: [0.7, 0.8], omega: [2.4, 2.6], f: 1.0}\n",
    "followed": "oscillator: {h: 0.1, R: 0.8, omega: [2.4, 2.6], f: 1.0}\n"
    "follow: {axis: omega, direction: both}\n",
    "starts": FIXED_OSCILLATOR + STARTS,
    "starts over a parameter": FIXED_OSCILLATOR.replace("2.6", "[2.6, 2.7]") + STARTS,
    "table": "points: {omega: [2.4, 2.6, 2.6], x0: [-1, -1, -2], part: [a, b, c]}\n"
    "oscillator: {h: 0.1, R: 0.8, f: 1.0}\n",
    "table of starts": "points: {x0: [-1, -1, -2], v0: [0, 1, 2]}\n" + FIXED_OSCILLATOR,
}
PERIODIC = RECORD.replace("4}", "4, diagnostics: [period]}")
FILES = {shape: SHAPES[shape] + PERIODIC for _, shape, _ in NAMES_ALONE}


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "blocks"), [*((shape, 0) for shape in SHAPES), ("table", None)])
def test_every_command_draws_or_refuses_every_file(shape, blocks, unpainted):
    """A refusal is one line; without a finished block only maps have something to show."""
    config = load(SHAPES[shape] + RECORD)
    if blocks is None:
        run_sweep(config, "a.h5")
    else:
        fill_blocks("a.h5", blocks, plan=planned(config, 2), results=None)
    for command in (["info"], ["info", "--bifurcations"], ["attractors", "--csv", "a.csv"],
                    ["integrity", "--csv", "b.csv"], ["export", "-o", "c.csv"], ["plot"],
                    ["plot", "--exact"], ["plot", "--quantity", "impulse"]):  # fmt: skip
        result = call(*command, "a.h5")
        assert result.exit_code == 0 or result.stderr.count("\n") == 1
    drawn = set()
    with open_sweep("a.h5") as dataset:
        sweep = OpenedSweep(dataset)
        for kind in KINDS:
            try:
                KINDS[kind].draw(sweep).draw_without_rendering()
                drawn.add(kind)
            except Refused as refused:
                assert "\n" not in str(refused)
    if blocks == 0:
        starts = {"map", "basins"}
        assert drawn == (starts if shape.startswith("starts") else {shape} & {"map"})
    else:
        assert drawn == {"table", "section", "impacts", "trajectory"}


def test_threads_take_turns_to_draw(random_sweep):
    """They share matplotlib's settings and its reader of formulas."""
    dataset, before = random_sweep({"omega": OMEGA, "R": R}), dict(mpl.rcParams)
    pages = [plotting.Page(grey=grey) for grey in (False, True)] * 3

    def colour(page):
        figure = section(dataset, page=page)
        figure.savefig(BytesIO(), dpi=20)
        return figure.axes[0].lines[0].get_color()

    with ThreadPoolExecutor(4) as pool:
        colours = list(pool.map(colour, pages))
    assert colours == colours[:2] * 3 and colours[0] != colours[1]
    assert dict(mpl.rcParams) == before
