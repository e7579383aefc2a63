"""The judge finds what was done to a cache, by as much as was done, and nothing else."""

import json
import shutil
from dataclasses import replace

import feathers
import numpy as np
import pytest
from commands import invoke
from places import SAMPLES
from pxr import Usd, UsdGeom, Vt
from usd_meshes import define_mesh, level_grid, new_stage

import featherfx
from featherfx.algebra.vectors import about_x
from featherfx.baking.entries import entries_of
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RowPoints, both, turned
from featherfx.usd.check import judge_kernels
from featherfx.usd.check.judge import judge_cache
from featherfx.usd.check.tracks import (
    BINS_PER_OCTAVE,
    KERATIN_MODULUS,
    MAX_STRESS,
    MIN_EXPONENT,
    OCTAVES,
    list_passed_bounds,
)
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

FORMS = {
    "mesh": {"group": "feather"},
    "one": {"group": "all"},
    "condensed": {"form": "condensed"},
    "both": {"form": "both"},
    "curves": {"form": "curves"},
    "payload": {"layout": "payload", "meters_per_unit": 0.01, "up_axis": "Y"},
}
SAMPLES_EACH, FRAMES, RATE = 4, (1, 3), 24.0
COUNT = (FRAMES[1] - FRAMES[0]) * SAMPLES_EACH + 1
SWING, PULSE = 0.7, 9.0  # rad, rad/s


def swung(rest, time):
    """Points about x, and their rates."""
    angle, rate = SWING * np.sin(PULSE * time), SWING * PULSE * np.cos(PULSE * time)
    points = turned(about_x(np.degrees(angle)).T, rest)
    return points, both(lambda part: rate * np.cross((1.0, 0.0, 0.0), part), points)


@pytest.fixture(scope="module")
def caches(tmp_path_factory):
    """Wing feathers that swing as rigid ones, in every form."""
    groom = featherfx.read_groom(SAMPLES / "swan_wing/groom.toml")
    groom = replace(groom, feathers=groom.feathers[::9])
    entries = entries_of(groom, build_feathers(groom.feathers, 11, 4), static=False)
    folder, made = tmp_path_factory.mktemp("judged"), {}
    for name, options in FORMS.items():
        made[name] = folder / f"{name}.usdc"
        how = WriteOptions(subframes=SAMPLES_EACH, **options)
        with CacheWriter(made[name], entries, FRAMES, RATE, how) as writer:
            for number in range(COUNT):
                code = FRAMES[0] + number / SAMPLES_EACH
                time = number / SAMPLES_EACH / RATE
                poses = [swung(entry.rest_points, time) for entry in entries]
                writer.write(feathers.frame_of(code, time, *zip(*poses, strict=True)))
    return made


@pytest.fixture(scope="module")
def sound(caches):
    return {name: judge_cache(path) for name, path in caches.items()}


@pytest.mark.parametrize("form", FORMS)
def test_rigid_feathers_keep_every_bound_in_every_form(sound, form):
    report, is_thinned = sound[form], form == "condensed"
    assert list(list_passed_bounds(report)) == []
    assert report["lengths"]["rachis_worst"] < (2e-3 if is_thinned else 1e-5)
    assert report["lengths"]["barb_worst"] < (5e-3 if is_thinned else 1e-5)
    assert report["pops"]["count"] == 0
    if is_thinned:
        assert report["velocity_mismatch"] is None
    else:
        # the next term of the difference: h^4 / 30 of the fifth derivative
        step = PULSE / RATE / SAMPLES_EACH
        assert report["velocity_mismatch"] < 3.0 * step**4 / 30.0 + 1e-3
        assert report["velocity_resolved"]


@pytest.fixture
def damaged(caches, tmp_path):
    """A copy of a cache whose points, or velocities, function has changed at all samples."""

    def make(form, function, name="points", kind=UsdGeom.Mesh):
        path = tmp_path / "damaged.usdc"
        shutil.copy(caches[form], path)
        stage = Usd.Stage.Open(str(path))
        prim = next(prim for prim in stage.Traverse() if prim.IsA(kind))
        attribute = prim.GetAttribute(name)
        for number, code in enumerate(attribute.GetTimeSamples()):
            values = np.array(attribute.Get(code))
            changed = function(values, number).astype(np.float32)
            attribute.Set(Vt.Vec3fArray.FromNumpy(changed), code)
        stage.GetRootLayer().Save()
        return judge_cache(path)

    return make


def scaled_at(sample, factor):
    return lambda values, number: values * (factor if number == sample else 1.0)


@pytest.mark.parametrize("form", ["mesh", "one"])
@pytest.mark.parametrize("factor", [1.02, 0.94, 3.0])
def test_a_stretch_is_found_with_its_size_and_frame(damaged, form, factor):
    report = damaged(form, scaled_at(3, factor))
    lengths = report["lengths"]
    assert lengths["rachis_worst"] == pytest.approx(abs(factor - 1.0), abs=1e-4)
    assert lengths["barb_worst"] == pytest.approx(abs(factor - 1.0), abs=1e-4)
    assert (lengths["feathers_over"] == 1) == (form == "mesh")
    assert lengths["worst"][0]["frame"] == pytest.approx(1.75)
    assert lengths["worst"][0]["feather"] in next(list_passed_bounds(report))


def test_a_barb_that_is_stretched_alone_is_no_rachis(damaged, sound):
    def pull(values, number):
        values[tip] += 0.004 if number == 2 else 0.0
        return values

    tip = 13  # an end of a barb
    report = damaged("mesh", pull)
    assert report["lengths"]["barb_worst"] > 0.005
    assert report["lengths"]["rachis_worst"] == sound["mesh"]["lengths"]["rachis_worst"]
    assert report["lengths"]["worst"][0]["part"] == "barb"


@pytest.mark.parametrize(
    ("turn", "told", "modulus"),
    [
        (2.0, {}, KERATIN_MODULUS),
        (60.0, {}, KERATIN_MODULUS),
        (20.0, {"kind_moduli": 8e9}, 8e9),
        (20.0, {"kind_moduli": 9e9, "id_moduli": 5e9}, 5e9),
        # softer material bears no more; and what is no number
        (20.0, {"kind_moduli": 34e6}, KERATIN_MODULUS),
        (20.0, {"kind_moduli": "stiff"}, KERATIN_MODULUS),
    ],
)
def test_a_bent_rachis_is_strained_by_half_its_height_times_its_curvature(
    tmp_path, turn, told, modulus
):
    """A straight tube becomes an arc of a circle, about y: as a beam is bent."""

    def bent(rest):
        along = rest.nodes[:, 0, 0]
        angle = turn * along
        arc = np.stack([np.sin(angle), 0.0 * angle, 1.0 - np.cos(angle)], axis=1) / turn
        frame = np.zeros((len(along), 3, 3))
        frame[:, 0, 0] = frame[:, 2, 2] = np.cos(angle)
        frame[:, 0, 2], frame[:, 2, 0] = np.sin(angle), -np.sin(angle)
        frame[:, 1, 1] = 1.0
        local = rest.nodes - rest.nodes[:, :1]
        nodes = arc[:, None] + np.einsum("nkc,ncd->nkd", local, frame)
        return RowPoints(nodes, np.einsum("nkc,ncd->nkd", rest.directors, frame))

    entry, path = feathers.entries()[0], tmp_path / "bent.usdc"
    still = both(np.zeros_like, entry.rest_points)
    name = {"id_moduli": entry.id, "kind_moduli": entry.kind}
    notes = {key: {name[key]: value} for key, value in told.items()}
    with CacheWriter(path, [entry], (1, 2), RATE, metadata=notes) as writer:
        for number, pose in enumerate((entry.rest_points, bent(entry.rest_points)), 1):
            writer.write(feathers.frame_of(number, number / RATE, [pose], [still]))
    report = judge_cache(path)
    step = turn * feathers.LENGTH / (feathers.ROWS - 1)
    # chords are shorter than the arc, and turn by what its sine is
    stretch = 1.0 - 2.0 * np.sin(step / 2.0) / step
    expected = feathers.RADIUS * turn * np.sin(step) / step + stretch
    found = report["strain_worst"]
    assert found["strain"] == pytest.approx(expected, rel=0.02)
    assert found["energy"] == pytest.approx(0.5 * modulus * expected**2 / 1150.0, rel=0.04)
    assert found["frame"] == 2.0
    sentences = [text for text in report["bounds_passed"] if "J/kg" in text]
    assert bool(sentences) == (expected > MAX_STRESS / modulus)


@pytest.mark.parametrize("away", [0.05, 0.2])
def test_a_jump_of_points_without_their_root_is_a_pop(damaged, away):
    def jump(values, number):
        if number == 4:
            far = np.linalg.norm(values - values[0], axis=1)
            values[far > 0.5 * far.max()] += (0.0, 0.0, 0.5 * away * far.max())
        return values

    report = damaged("mesh", jump)
    assert report["pops"]["unexplained"] == report["pops"]["count"] == (away > 0.1)
    if away > 0.1:
        worst = report["pops"]["worst"]
        assert worst["frame"] == pytest.approx(2.0)
        # a second difference of a lone sample is twice as far
        assert worst["of_length"] == pytest.approx(away, rel=0.3)


def test_a_jump_that_the_root_makes_is_none(damaged):
    report = damaged("mesh", lambda values, number: values + 0.1 * (number == 4))
    assert report["pops"]["count"] == 0


@pytest.mark.parametrize("kind", [UsdGeom.Mesh, UsdGeom.BasisCurves])
@pytest.mark.parametrize("bend", [0.0, 0.8])
def test_a_turn_of_the_root_is_no_pop_but_what_moves_besides_is(damaged, kind, bend):
    """The whole feather turns by 40 degrees in one sample and back; its tip may bend besides."""
    sine, cosine = np.sin(np.radians(40.0)), np.cos(np.radians(40.0))
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])

    def move(values, number):
        if number != 4:
            return values
        root = values[0].copy()
        far = np.linalg.norm(values - root, axis=1)
        values = values.copy()
        values[far > 0.5 * far.max()] += (0.0, 0.5 * bend * far.max(), 0.0)
        return (values - root) @ turn.T + root

    assert (damaged("mesh", move, kind=kind)["pops"]["count"] > 0) == (bend > 0.1)


def test_a_rachis_whose_base_bends_a_little_to_either_side_is_no_pop(damaged):
    def bend(values, number):
        share = np.linspace(0.0, 1.0, len(values))[:, None]
        chord = values[-1] - values[0]
        side = np.cross(chord, (0.0, 0.0, 1.0))
        beyond = np.maximum(share - 0.5, 0.0) ** 2 + 0.01 * (-1.0) ** number * share**2
        return values[0] + share * chord + beyond * side

    assert damaged("mesh", bend, kind=UsdGeom.BasisCurves)["pops"]["count"] == 0


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.2, 1e6])
def test_velocities_are_held_against_the_motion(damaged, factor):
    report = damaged("one", lambda values, number: values * factor, "velocities")
    # fast points are off by more than the rms speed
    assert report["velocity_mismatch"] > abs(factor - 1.0)
    assert [text for text in list_passed_bounds(report) if "velocities" in text]


def _unexplained(place, rate, step):
    """Velocities `rate` of one point at `place`, both along time, against its places: what is left
    of them, over the rms speed, by counting as the judge does."""
    counts, squares = np.zeros((3, OCTAVES * BINS_PER_OCTAVE), dtype=np.int64), 0.0
    for k in range(2, len(place) - 2):
        points = tuple(np.array([[x, 0.0, 0.0]], np.float32) for x in place[k - 2 : k + 3])
        rates = np.array([[rate[k], 0.0, 0.0]], np.float32)
        squares += judge_kernels.count_errors(points, rates, step, counts)
    rms = np.sqrt(squares / (len(place) - 4))
    exponents = MIN_EXPONENT + np.arange(counts.shape[1]) / BINS_PER_OCTAVE
    return [2.0 ** exponents[np.flatnonzero(each)[-1]] / rms for each in counts[:2]]


def test_velocities_at_kinks_and_of_motion_between_samples_are_explained():
    time = np.arange(60) / 96.0
    kinked, onwards = np.interp(time, [0.0, 0.25, 1.0], [0.0, 0.1, -0.2]), 0.4 * np.ones(60)
    onwards[time >= 0.25] = -0.4
    plain, left = _unexplained(kinked, onwards, 1.0 / 96.0)
    assert plain > 0.5 > 1e-3 > left
    # 30 Hz, a third of the samples' rate, of little way
    quick = 188.5
    swing, rate = np.sin(6.0 * time), 6.0 * np.cos(6.0 * time)
    waves, waving = 4e-3 * np.sin(quick * time), 4e-3 * quick * np.cos(quick * time)
    plain, left = _unexplained(swing + waves, rate + waving, 1.0 / 96.0)
    assert plain > 0.03 > left
    # of the step before: half of what a step adds
    behind = np.diff(swing, prepend=0.0) * 96.0
    plain, left = _unexplained(swing, behind, 1.0 / 96.0)
    assert left > 0.8 * 0.5 * 6.0 / 96.0


def test_check_measures_caches_and_is_strict_where_asked(caches, tmp_path):
    told = json.loads(invoke("check", caches["mesh"], "--json").stdout)
    assert told["problems"] == []
    assert told["lengths"]["feathers_over"] == told["pops"]["count"] == 0
    assert told["velocity_mismatch"] < 0.03
    path = tmp_path / "bad.usdc"
    shutil.copy(caches["mesh"], path)
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            points = prim.GetAttribute("points")
            code = points.GetTimeSamples()[2]
            points.Set(Vt.Vec3fArray.FromNumpy(np.array(points.Get(code)) * np.float32(1.1)), code)
            UsdGeom.Mesh(prim).GetExtentAttr().Set(
                UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), code), code
            )
    stage.GetRootLayer().Save()
    assert invoke("check", path).exit_code == 0
    strict = invoke("check", "--strict", path)
    assert strict.exit_code == 1
    assert "featherfx: warning:" in strict.stderr
    assert "(bound 0.5 %)" in strict.stderr


@pytest.mark.parametrize("height", [0.002, -5e-5, -0.002])
def test_vanes_in_the_skin_are_as_deep_as_they_lie(tmp_path, height):
    skin, path = tmp_path / "skin.usda", tmp_path / "cache.usdc"
    stage = new_stage(skin)
    define_mesh(stage, "/skin", *level_grid(-0.5, 0.5, 41), scheme=None)
    stage.Save()
    named = {"role": "skin", "file": "skin.usda", "prim": "/skin"}
    named |= dict.fromkeys(("start", "first", "time_codes_per_frame"), 1.0)
    told = {"scenery": {"0": named}, "thickness": 1e-4}
    entry = feathers.entries()[0]
    still = both(np.zeros_like, entry.rest_points)
    with CacheWriter(path, [entry], (1, 3), RATE, metadata=told) as writer:
        for number in (1, 2, 3):
            at = feathers.placed((0.0, 0.0, height if number == 2 else 0.01))
            writer.write(feathers.frame_of(number, number / RATE, [at], [still]))
    report = judge_cache(path)
    depth = report["skin_depth"]
    assert depth["feathers_over"] == (height < -1e-4)
    assert depth["thickness"] == 1e-4
    if height < 0.0:
        assert depth["worst"]["depth"] == pytest.approx(-height, rel=1e-4)
        assert depth["worst"]["frame"] == 2.0
    assert bool([text for text in report["bounds_passed"] if "in the skin" in text]) == (
        height < -1e-4
    )
