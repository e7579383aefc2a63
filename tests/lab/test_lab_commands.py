"""`featherfx lab`: keys, units and bad input."""

import json

import numpy as np
import pytest
from commands import invoke

from featherfx.cli.lab.experiments import COMMANDS, EXPERIMENTS
from featherfx.cli.lab.measure import lab
from featherfx.lab.studies.study import STUDIES

ROD = ("--length", "0.3", "--ei", "2e-3")
TRIAL = ("feather", "--preset", "swan_primary", "--rows", "9", "--columns", "3")


def run(*arguments):
    return invoke("lab", *arguments)


def values(*arguments):
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    return json.loads(result.stdout)


def test_rod_gives_tip_and_points():
    # small force: F L^3 / 3 EI
    found = values("rod", *ROD, "--tip-force", "0,2e-4,-1e-4", "--segments", "20")
    assert list(found) == ["tip", "points", "iterations", "residual", "seconds"]
    assert np.shape(found["points"]) == (21, 3)
    assert found["points"][0] == [0.0, 0.0, 0.0]
    assert found["points"][-1] == found["tip"]
    sag = 1e-4 * 0.3**3 / 3 / 2e-3
    assert found["tip"] == pytest.approx([0.3, 2 * sag, -sag], rel=2e-3)


def test_rod_options_reach_the_rod():
    """Each option moves the tip the way its stiffness says."""
    load = ("--tip-force", "0.001,0.01,-0.01", "--line-weight", "0.01")
    plain = values("rod", *ROD, *load)["tip"]
    stiff = values("rod", *ROD, *load, "--ei2", "1")["tip"]
    assert abs(stiff[2]) < 0.1 * abs(plain[2])
    assert abs(stiff[1]) > 0.5 * abs(plain[1])
    assert values("rod", *ROD, *load, "--taper", "0.5")["tip"][1] > 1.5 * plain[1]
    assert values("rod", *ROD, "--rest-curvature", "2")["tip"] == pytest.approx(
        [np.sin(0.6) / 2, (1 - np.cos(0.6)) / 2, 0.0]
    )
    assert values("rod", *ROD, "--ea", "1", "--tip-force", "0.1,0,0")["tip"][0] == pytest.approx(
        0.33
    )


def test_modes_gives_frequencies_in_hz():
    found = values("modes", *ROD, "--line-mass", "0.01", "--count", "3")
    assert list(found) == ["frequencies_hz", "decrements"]
    first = 1.8751**2 * np.sqrt(2e-3 / 0.01) / 0.3**2 / (2 * np.pi)
    assert found["frequencies_hz"][:2] == pytest.approx([first, first], rel=2e-3)
    assert len(found["frequencies_hz"]) == 3


def test_release_gives_the_trajectory():
    found = values(
        *("release", *ROD, "--line-mass", "0.01", "--line-weight", "0.1"),
        *("--duration", "0.1", "--tolerance", "1e-5", "--samples", "20", "--rest-curvature", "1"),
    )
    assert list(found) == ["time", "tip", "energy", "steps", "seconds"]
    assert found["time"] == pytest.approx(np.linspace(0.0, 0.1, 21))
    assert found["tip"][0] == [0.3, 0.0, 0.0]
    assert np.shape(found["tip"]) == (21, 3)
    assert found["steps"] >= 20
    # held straight against its rest curvature: 1/2 EI K^2 L; let go, it may lose what rings fast
    energy = np.array(found["energy"])
    assert energy[0] == pytest.approx(0.5 * 2e-3 * 0.3, rel=1e-3)
    assert energy.max() < 1.001 * energy[0]
    assert energy.min() > 0.9 * energy[0]


def test_shaken_feather_gives_all_figures():
    found = values(
        *(*TRIAL, "--coefficients", "1", "--shake-amplitude", "0.02", "--shake-frequency", "3"),
        *("--duration", "0.1", "--fixed-step", "0.01"),
    )
    assert list(found) == [
        "points",
        "iterations_per_step",
        "steps",
        "unknowns",
        "barb_strain_max",
        "seconds",
        "seconds_assembly",
        "seconds_solve",
    ]
    assert np.shape(found["points"]) == (9, 1 + 2 * 3, 3)
    assert (found["steps"], found["unknowns"]) == (10, 9 * 10)
    # the root at 0.3 periods, past its smooth start
    assert found["points"][0][0] == pytest.approx([0.0, 0.0, 0.02 * np.sin(0.6 * np.pi)])
    assert found["barb_strain_max"] < 1e-12
    assert 0.0 < found["seconds_solve"] + found["seconds_assembly"] < 10.0 * found["seconds"]
    assert 1.0 <= found["iterations_per_step"] < 12.0


def test_pulled_feather_is_pulled():
    still = values(*TRIAL, "--duration", "0.1")["points"]
    pulled = values(*TRIAL, "--duration", "0.1", "--pull", "0,0,0.02")["points"]
    moved = np.subtract(pulled, still)[-1, 0]
    assert moved == pytest.approx([0.0, 0.0, 0.02], abs=2e-3)


def test_tables_without_json():
    result = run("rod", *ROD, "--segments", "3", "--tip-force", "0,0,-0.01")
    lines = result.stdout.splitlines()
    assert lines[0].split()[0] == "tip"
    assert [line.split()[0] for line in lines if not line.startswith(" ")] == [
        "tip",
        "points",
        "iterations",
        "residual",
        "seconds",
    ]


OPTIONS = {
    "rod": "length ei ei2 gj ea ga taper rest-curvature segments line-weight tip-force",
    "modes": "length ei ei2 gj ea ga taper rest-curvature segments line-mass count loss-factor"
    " kind air presets",
    "air": "kind angles speed presets",
    "fall": "kind duration tolerance presets",
    "release": "length ei ei2 gj ea ga taper rest-curvature segments line-weight line-mass duration"
    " tolerance loss-factor samples radius",
    "feather": "preset kinematics rows columns coefficients shake-amplitude shake-frequency pull"
    " duration tolerance fixed-step presets",
    "strip": "scene dt kinematics columns refinement coefficients method stretch radius newton",
    "plate": "along across twist coupling angle length width deflection rows columns",
    "ribbon": "length width tip-width rigidity density rest-curvature poisson elements grading"
    " series degree sadowsky clamp planar wind seconds step",
    "fullfeather": "scene material distance parts rows columns nodal guard",
    "unitcell": "preset angle spacing diameter young hooks save presets",
    "network": "lattice size dilution fibres density merge bend seed scatter",
    "precondition": "lattice size dilution fibres density merge bend seed method preconditioner"
    " tolerance scatter",
    "traction": "angle width height thickness along across shear strain steps elements mesh model"
    " guard output",
    "locking": "ratio elements output",
    "mesoscale": "barb-fraction barb-spacing barb barbule angle width height strain steps"
    " size-effect output",
    "rupture": "elements sigma mu critical release stiffness exponent weak weak-mu scatter seed"
    " step fibres",
    "tear": "direction preset rows columns width height rate furthest step scatter release output",
    "cycle": "direction preset strains rows columns parts",
    "calibrate": "elements preset save name cycles law",
    "contact": "case n thickness quality tolerance steps at-rest",
    "angles": "barb-fraction barb-spacing barb barbule angle aspect pictures output",
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_options_keep_their_names(name):
    """Other programs call them."""
    options = {each for option in COMMANDS[name].params for each in option.opts}
    long = {each[2:] for each in options if each.startswith("--")}
    assert long == {*OPTIONS[name].split(), "json", "log", "verbose"}


def test_a_declaration_is_option_range_and_default():
    """Units, ranges and defaults of an experiment stand in one place."""
    text = run("strip", "--help").stdout
    assert "s, longest step.  [required]" in " ".join(text.split()).replace(". [", ".  [")
    assert "[default: 1e-05]" in text
    assert run("strip", "--scene", "iso", "--dt", "1").stderr == (
        "featherfx: strip: dt: 1 is not allowed. Give above 0 to 0.1 s.\n"
    )


def test_list_names_every_experiment():
    result = run("--list")
    assert result.exit_code == 0
    named = {line.split()[0] for line in result.stdout.splitlines() if line.startswith("  ")}
    assert set(lab.commands) < named
    assert {study.name for study in STUDIES} < named
    assert "Bisshopp" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "keys"),
    [
        (("rod", "--length", "0", "--ei", "-1"), ("length", "ei")),
        (("rod", *ROD, "--taper", "1", "--segments", "1"), ("taper", "segments")),
        (("rod", *ROD, "--gj", "nan", "--tip-force", "inf,0,0"), ("gj", "tip_force")),
        (("rod", *ROD, "--rest-curvature", "1e9"), ("rest_curvature",)),
        (("modes", *ROD, "--count", "0", "--line-mass", "0"), ("line_mass", "count")),
        (("release", *ROD, "--duration", "-1", "--tolerance", "0"), ("duration", "tolerance")),
        (("release", *ROD, "--duration", "1", "--radius", "2"), ("radius",)),
        (
            ("feather", "--preset", "swan_primary", "--rows", "2", "--duration", "0"),
            ("duration", "rows"),
        ),
        (("feather", "--preset", "no_such_feather", "--columns", "0"), ("columns", "no_such")),
        (("feather", "--preset", "swan_vane"), ("swan_vane",)),
        (
            (
                *("ribbon", "--length", "0", "--width", "-1"),
                *("--rigidity", "nan", "--density", "1"),
            ),
            ("length", "width", "rigidity"),
        ),
        (("unitcell", "--preset", "swan_primary", "--angle", "95"), ("angle",)),
        (("unitcell", "--preset", "swan_vane"), ("swan_vane",)),
        (
            ("unitcell", "--preset", "swan_primary", "--spacing", "0", "--hooks", "-1"),
            ("barbule_spacing", "hooks"),
        ),
        (("locking", "--ratio", "0", "--elements", "-3"), ("ratio", "elements")),
        (("fullfeather", "--scene", "tip", "--distance", "nan"), ("distance",)),
    ],
)
def test_wrong_values_are_all_told_and_exit_with_one(arguments, keys):
    result = run(*arguments)
    assert result.exit_code == 1
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == len(keys)
    for line, key in zip(lines, keys, strict=True):
        assert line.startswith("featherfx: ")
        assert key in line


@pytest.mark.parametrize(
    "arguments",
    [
        ("rod", *ROD, "--tip-force", "1,2"),
        ("rod", "--ei", "1"),
        ("fullfeather",),
        ("feather", "--preset", "swan_primary", "--shake-amplitude", "1"),
        (*TRIAL, "--pull", "0,0,1", "--shake-amplitude", "1", "--shake-frequency", "1"),
        ("no_such_experiment",),
    ],
)
def test_wrong_usage_exits_with_two(arguments):
    assert run(*arguments).exit_code == 2


def test_measure_house_counts_each_line_once(tmp_path):
    (tmp_path / "one/two").mkdir(parents=True)
    (tmp_path / "one/two/__init__.py").touch()
    (tmp_path / "one/__init__.py").write_text('"""Things.\n\nChange here: a thing.\n"""\n')
    (tmp_path / "one/two/a.py").write_text("# why\nx = 1\n")
    assert run("measure", "house", str(tmp_path)).stdout.splitlines()[2:] == [
        "| one | 3 | 6 | Things. | a thing. |",
        "| one/two | 2 | 2 |  |  |",
        "| all | 3 | 6 |  |  |",
    ]


def test_measure_scaling_keeps_the_droop_of_similar_feathers_in_proportion():
    rows = [
        row.split(" | ")
        for row in run("measure", "scaling").stdout.splitlines()
        if "similar" in row
    ]
    droop = {float(size): float(tip) for _, size, tip, _, _ in rows}
    assert droop[2.0] == pytest.approx(2.0 * droop[1.0], rel=0.05)


@pytest.mark.parametrize("swan", [(), ("--swan",)])
def test_measure_plumage_bakes_what_it_writes(swan, tmp_path):
    arguments = ("--frames", "2", "-o", str(tmp_path))
    result = run("measure", "plumage", "30", *swan, *arguments)
    assert result.exit_code == 0, result.stderr
    title, _, row = (line.strip("| ").split(" | ") for line in result.stdout.splitlines())
    assert title[0] == "feathers"
    assert len(row) == len(title)
    assert (tmp_path / "30/cache/plumage.usdc").is_file()
