"""Scaled, stiffened and weighted feathers: what the rules of scaling say, of models and poses."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import Change, adjusted, kind_of
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.read.read import read_groom
from featherfx.groom.types import VaneShape
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.damping import frequencies
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state

GRAVITY = 9.81
RULES = ("similar", "behaviour")


@cache
def kind(scaling="similar", clamp=0.0, exponent=1.0):
    _, tree = load_preset("feather/swan_primary")
    for name, value in (("barb_clamp_normal", clamp), ("barb_clamp_in_plane", 2.0 * clamp)):
        old = tree["vane_material"][name]
        tree["vane_material"][name] = old.__class__(value, old.source)
    old = tree["vane_material"]["compression_guard"]
    tree["vane_material"]["compression_guard"] = old.__class__(1e5, old.source)
    tree["scaling"] = old.__class__(scaling, "test")
    tree["thickness_exponent"] = old.__class__(exponent, "test")
    return kind_of("swan_primary", tree, Place("", "", Problems()))


def model_of(which):
    return make_model([build_feather(which, 9, 3)], [which], 1)


def rates(which):
    return frequencies(model_of(which), 0, 6)


def droop(which, size=1.0, gravity=GRAVITY):
    """Settled nodes over the size."""
    model = model_of(which)
    start = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    with Solver(model, Settings(tolerance=1e-4 * size, newton=1e-9 * size)) as solver:
        loads = no_loads(1, (0.0, 0.0, -gravity))
        state, status, _ = solver.equilibrium(start, loads)
    assert status[0] == 0
    return (state.points.nodes[0] - start.points.nodes[0]) / size


@pytest.mark.parametrize("clamp", [0.0, 2.0])
@pytest.mark.parametrize(("stiffness", "weight"), [(4.0, 1.0), (1.0, 4.0), (3.0, 0.5)])
def test_frequencies_go_as_the_root_of_stiffness_over_weight(stiffness, weight, clamp):
    own = kind("similar", clamp)
    dialled = adjusted(own, Change(stiffness=stiffness, weight=weight))
    assert rates(dialled) == pytest.approx(np.sqrt(stiffness / weight) * rates(own), rel=1e-6)


@pytest.mark.parametrize("clamp", [0.0, 2.0])
@pytest.mark.parametrize("size", [0.3, 2.0])
@pytest.mark.parametrize(("scaling", "power"), [("similar", -1.0), ("behaviour", -0.5)])
def test_all_frequencies_follow_the_rule_of_scaling(scaling, power, size, clamp):
    own = kind(scaling, clamp)
    larger = adjusted(own, Change(scale=size))
    assert rates(larger) == pytest.approx(size**power * rates(own), rel=1e-6)


def test_a_feather_that_keeps_its_behaviour_hangs_as_before():
    larger = adjusted(kind("behaviour"), Change(scale=2.0))
    own = droop(kind("behaviour"))
    assert np.abs(own).max() > 1e-4
    assert droop(larger, 2.0) == pytest.approx(own, abs=1e-6 * np.abs(own).max())


def test_a_similar_feather_hangs_as_in_so_much_more_gravity():
    larger = adjusted(kind("similar"), Change(scale=2.0))
    wanted = droop(kind("similar"), gravity=2.0 * GRAVITY)
    assert droop(larger, 2.0) == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())


def test_with_a_fixed_vane_only_the_shaft_follows():
    larger = adjusted(kind("fixed_vane"), Change(scale=2.0))
    assert larger.vane_material == kind("fixed_vane").vane_material
    assert larger.rachis.diameter_base == 2.0 * kind().rachis.diameter_base
    # the ragged vane of old: barbs of twice the length and the same stiffness hang much further
    ends = np.abs(droop(larger, 2.0)[:, :, 2]).max()
    similar = np.abs(droop(adjusted(kind("similar"), Change(scale=2.0)), 2.0)[:, :, 2]).max()
    assert ends > 1.5 * similar


def test_walls_and_vanes_thicken_less_than_they_lengthen():
    own = kind(exponent=0.6)
    longer, wall = adjusted(own, Change(scale=2.0)), own.rachis_material.cortex_fraction
    assert longer.rachis.diameter_base == 2.0 * own.rachis.diameter_base
    assert longer.rachis_material.cortex_fraction == pytest.approx(2.0**-0.4 * wall)
    for name, power in (("surface_density", 0.6), ("thickness", 0.6), ("bending_across", 1.8)):
        ratio = getattr(longer.vane_material, name) / getattr(own.vane_material, name)
        assert ratio == pytest.approx(2.0**power), name
    bare, other = (
        replace(each, leading=VaneShape((), ()), trailing=VaneShape((), ()))
        for each in (own, longer)
    )
    # a thin wall bends as s^2 t and weighs so, but for its core
    assert rates(other) == pytest.approx(0.5 * rates(bare), rel=0.03)
    assert adjusted(own, Change(scale=1e-3)).rachis_material.cortex_fraction == 1.0


@pytest.mark.parametrize("scaling", RULES)
def test_two_steps_of_size_are_one(scaling):
    once = adjusted(kind(scaling, 1.0), Change(scale=6.0))
    twice = adjusted(adjusted(kind(scaling, 1.0), Change(scale=2.0)), Change(scale=3.0))
    for part in ("vane_material", "rachis_material"):
        found, wanted = ({**vars(getattr(each, part))} for each in (twice, once))
        others = [name for name in wanted if name.endswith(("_profile", "_band"))]
        assert all(found.pop(name) == wanted.pop(name) for name in others)
        assert found == pytest.approx(wanted)
    assert twice.barb_spacing == pytest.approx(once.barb_spacing)


GROOM = """
name = "dials"
[[feather]]
id = "one"
kind = "stiff"
position = [0, 0, 0]
stiffness = 3
weight = 2
[[row]]
id = "row"
kind = "swan_primary"
count = 2
first = { position = [0, 0, 0], direction = [1, 0, 0], up = [0, 0, 1] }
last = { position = [0, 1, 0], direction = [1, 0, 0], up = [0, 0, 1] }
stiffness = 5
overrides = { weight = 7 }
[[table]]
file = "more.csv"
kind = "swan_primary"
weight = 0.5
[overrides]
row_02 = { stiffness = 2, scaling = "behaviour", scale = 2 }
"""
CSV = """id,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z,stiffness
csv,0,0,0,1,0,0,0,0,1,1.5
"""


def test_dials_of_presets_rows_tables_and_overrides_multiply(tmp_path):
    (tmp_path / "feather").mkdir()
    preset = 'base = "swan_primary"\nstiffness = 2\n'
    (tmp_path / "feather/stiff.toml").write_text(preset)
    (tmp_path / "groom.toml").write_text(GROOM)
    (tmp_path / "more.csv").write_text(CSV)
    groom = read_groom(tmp_path / "groom.toml", [tmp_path])
    found = {each.id: each.kind for each in groom.feathers}
    plain = found["csv"].rachis_material.youngs_modulus / 1.5
    young = {name: each.rachis_material.youngs_modulus / plain for name, each in found.items()}
    # the last one is stiffer by its size, too
    assert young == pytest.approx({"one": 6, "row_01": 5, "row_02": 20, "csv": 1.5})
    mass = {name: each.rachis_material.cortex_density / 1250 for name, each in found.items()}
    assert mass == pytest.approx({"one": 2, "row_01": 7, "row_02": 7, "csv": 0.5})


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("stiffness = 0", "feather[0].stiffness: 0 is out of range. Give 0.001 to 1000"),
        ('weight = "heavy"', "feather[0].weight: 'heavy' is not a number"),
        (
            'overrides = { scaling = "similiar" }',
            "feather[0].overrides.scaling: 'similiar' is not allowed, did you mean 'similar'?",
        ),
    ],
)
def test_bad_dials_are_named(tmp_path, line, said):
    path = tmp_path / "groom.toml"
    head = 'name = "x"\n[[feather]]\nid = "a"\nkind = "covert"\nposition = [0, 0, 0]\n'
    path.write_text(head + line)
    with pytest.raises(InputError) as caught:
        read_groom(path)
    assert said in str(caught.value)
