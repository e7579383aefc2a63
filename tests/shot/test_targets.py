"""Pose targets: feathers are brought to a shape, held in it and let go."""

from __future__ import annotations

import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES
from pxr import Usd, UsdGeom, Vt

import featherfx
from featherfx.errors import InputError, InputWarning
from featherfx.shot.direction.targets import _shortest, along_line
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import motion_dependences
from featherfx.shot.patterns import Channel, Detail, Target
from featherfx.shot.types import Motion

SAMPLE = SAMPLES / "swan_wing"
HELD = ((3, 0), (8, 1), (14, 1), (20, 0))
FEATHER = "right_secondary_01"


@pytest.fixture(scope="module")
def shot():
    """A beating wing on a coarse grid."""
    read = featherfx.read_shot(SAMPLE / "shot.toml")
    quality = replace(read.quality.pushing, rows=11, columns=3, coefficients=1, simulated_rows=0)
    # what is held bent for six frames swings out with its air, and creeps back, within 14
    return replace(read, quality=quality, last_frame=34)


def moved(shot, *targets):
    """(T, n, 1 + 2 m, 3) m nodes of one feather over all frames, and the simulation."""
    run = simulate(replace(shot, targets=targets), wanted=[0])
    assert run.shot.groom.feathers[0].id == FEATHER
    return np.array([frame.poses[0].points.nodes for frame in run]), run


@pytest.fixture(scope="module")
def free(shot):
    return moved(shot)[0]


@pytest.fixture(scope="module")
def bent(shot):
    """A shape that the feathers can have: limp ones that fall upwards, at frame 14."""
    limp = Channel(name="stiffness", keys=((1, 0.2),)), Channel(name="gravity", keys=((1, -10.0),))
    *_, last = simulate(replace(shot, channels=limp, last_frame=14))
    return {
        placement.id: feather.surface.points(pose.points)
        for placement, feather, pose in zip(
            shot.groom.feathers, drawn_feathers(shot), last.poses, strict=True
        )
    }


def length(shot):
    return drawn_feathers(shot)[0].station[-1]


@pytest.mark.parametrize("tolerance", [1.0, 0.1])
def test_a_shape_is_reached_within_the_tolerance_and_left(shot, free, bent, tolerance):
    target = Target(shape="bent", points=bent, frame=14, keys=HELD, tolerance=tolerance)
    nodes, run = moved(shot, target)
    way = np.linalg.norm(nodes - free, axis=-1).max(axis=(1, 2)) / length(shot)
    assert way[:3].max() < 1e-9  # before
    assert way[9:13].min() > 0.1  # held somewhere else
    assert way[-1] < 0.01  # and back
    # at frame 14, where the shape is from, in the same place
    surface = drawn_feathers(shot)[0].surface
    on_node = (surface.offset == 0.0).all(axis=1)
    there = nodes[13][surface.row, surface.node][on_node]
    apart = np.linalg.norm(there - bent[FEATHER][on_node], axis=1).max() / length(shot)
    assert 100.0 * apart < tolerance
    (told,) = run.report["targets"]
    assert 100.0 * apart <= told["deviation"] * (1.0 + 1e-9) < tolerance
    # neither taken hold of nor let go in one frame
    assert np.abs(np.diff(way)).max() < 0.6 * way.max()


def test_a_feather_that_is_held_at_rest_follows_its_root(shot, free):
    nodes, run = moved(shot, Target(keys=((1, 1),), tolerance=0.1))
    (told,) = run.report["targets"]
    assert told["deviation"] < 0.1
    assert np.linalg.norm(nodes - free, axis=-1).max() > 0.002 * length(shot)


def test_an_outline_is_kept_within_a_distance(shot, free):
    """Of the rest shape on its root, from which a beat of the wing takes it farther."""
    within = 0.005 * length(shot)  # the error of a step is up to 0.001
    rigid = moved(shot, Target(keys=((1, 1),), tolerance=0.05))[0]
    kept, run = moved(shot, Target(keys=((1, 1),), within=within, tolerance=0.3))
    apart, before = (np.linalg.norm(x - rigid, axis=-1).max() for x in (kept, free))
    assert before > 2.0 * within
    # free in half of it, and stopped in the other
    assert 0.5 * within < apart < within
    assert run.report["targets"][0]["deviation"] == 0.0


def test_other_feathers_move_as_before_and_need_no_new_bake(shot, free):
    target = Target(keys=HELD, feathers="left*")
    assert np.array_equal(moved(shot, target)[0], free)
    before, after = motion_dependences(shot), motion_dependences(replace(shot, targets=(target,)))
    changed = {f.id for f, a, b in zip(shot.groom.feathers, before, after, strict=True) if a != b}
    assert changed == {f.id for f in shot.groom.feathers if f.id.startswith("left")}


LEVELS = {
    "rigid": (Detail(level="rigid", feathers=FEATHER),),
    "guided": (Detail(level="guided", feathers=FEATHER, every=0),),
}


@pytest.mark.parametrize("level", LEVELS)
def test_feathers_that_are_not_simulated_are_led_to_a_shape_and_left(shot, bent, level):
    """They are in it as near as its own lengths let them be, with rates of the way there."""
    own = replace(shot, details=LEVELS[level])
    target = Target(shape="bent", points=bent, frame=14, keys=HELD, tolerance=0.5, feathers=FEATHER)
    (plain, _), (nodes, run) = moved(own), moved(own, target)
    way = np.linalg.norm(nodes - plain, axis=-1).max(axis=(1, 2)) / length(shot)
    assert way[:3].max() < 1e-9 > way[-1]
    assert way[9:13].min() > 0.1
    surface = drawn_feathers(shot)[0].surface
    on_node = (surface.offset == 0.0).all(axis=1)
    there = nodes[13][surface.row, surface.node][on_node]
    apart = 100.0 * np.linalg.norm(there - bent[FEATHER][on_node], axis=1).max() / length(shot)
    assert apart <= run.report["targets"][0]["deviation"] * (1.0 + 1e-9) < 0.5
    chords = np.linalg.norm(np.diff(nodes[:, :, 0], axis=1), axis=-1)
    assert chords == pytest.approx(np.broadcast_to(chords[0], chords.shape), rel=1e-9)


def test_rates_of_led_feathers_are_those_of_their_motion(shot, bent):
    own = replace(shot, details=LEVELS["rigid"], last_frame=8)
    target = Target(shape="bent", points=bent, frame=14, keys=HELD)
    run = simulate(replace(own, targets=(target,)), wanted=[0], subframes=8)
    poses = [frame.poses[0] for frame in run]
    nodes, rates = (
        np.array([p.nodes for p in each])
        for each in zip(*((pose.points, pose.velocities) for pose in poses), strict=True)
    )
    step = 1.0 / (8 * own.frames_per_second)
    between = (nodes[2:] - nodes[:-2]) / (2.0 * step)
    assert np.abs(between - rates[1:-1]).max() < 0.02 * np.abs(rates).max()


def test_a_led_feather_keeps_an_outline(shot, bent):
    own = replace(shot, details=LEVELS["rigid"])
    aim = Target(shape="bent", points=bent, frame=14, keys=((1, 1),))
    held, near = (
        moved(own, replace(aim, within=within))[0][13] for within in (0.0, 0.03 * length(shot))
    )
    apart = np.linalg.norm(held - near, axis=-1).max() / length(shot)
    assert 0.02 < apart < 0.0305


def test_feathers_that_are_excluded_are_left_alone(shot, free):
    target = Target(keys=((1, 1),), exclude=("right_secondary_0?",))
    assert np.array_equal(moved(shot, target)[0], free)


def test_a_led_feather_turns_at_its_root_as_its_shape_does(shot):
    """It leaves its root by 30 degrees; taken as if it did not, the tip was 52 % off."""
    root, long = shot.groom.feathers[0], length(shot)
    way = np.array((np.cos(np.pi / 6), 0.0, -np.sin(np.pi / 6)))
    line = root.position + np.linspace(0.0, long, 11)[:, None] * (root.rotation @ way)
    target = Target(shape="drawn", lines={FEATHER: line}, keys=((1, 1),), feathers=FEATHER)
    _, run = moved(replace(shot, details=LEVELS["rigid"], last_frame=2), target)
    assert run.report["targets"][0]["deviation"] < 0.1


def test_a_shape_that_stretches_the_feather_is_told(shot, bent):
    far = {name: 2.0 * points for name, points in bent.items()}
    target = Target(shape="far", points=far, frame=14, keys=((10, 0), (14, 1)))
    with pytest.warns(InputWarning, match=r"target\[0\].*% of its length off at frame"):
        moved(shot, target)


@pytest.fixture(scope="module")
def lines(shot, bent):
    """Curves along the shafts of that shape, root to tip."""
    found = {}
    for placement, feather in zip(shot.groom.feathers, drawn_feathers(shot), strict=True):
        surface = feather.surface
        on_shaft = (surface.offset == 0.0).all(axis=1) & (surface.node == 0)
        order = np.argsort(surface.row[on_shaft], kind="stable")
        found[placement.id] = bent[placement.id][on_shaft][order]
    return found


@pytest.mark.parametrize("tolerance", [1.0, 0.1])
def test_a_curve_is_reached_by_the_shaft_and_left(shot, free, bent, lines, tolerance):
    # longer, and beside the root: the form counts
    drawn = {name: 1.5 * (line - line[0]) + line[0] + 0.01 for name, line in lines.items()}
    target = Target(shape="drawn", lines=drawn, frame=14, keys=HELD, tolerance=tolerance)
    nodes, run = moved(shot, target)
    way = np.linalg.norm(nodes - free, axis=-1).max(axis=(1, 2)) / length(shot)
    assert way[9:13].min() > 0.1
    assert way[-1] < 0.01
    (told,) = run.report["targets"]
    assert told["deviation"] < tolerance
    # the shaft is where it is in the shape that the curves were taken from; vanes are as at rest
    surface = drawn_feathers(shot)[0].surface
    on_node = (surface.offset == 0.0).all(axis=1)
    apart = np.linalg.norm(
        nodes[13][surface.row, surface.node][on_node] - bent[FEATHER][on_node], axis=1
    ) / length(shot)
    of_shaft = surface.node[on_node] == 0
    assert 100.0 * apart[of_shaft].max() < tolerance + 0.1
    rest = drawn_feathers(shot)[0].rest.nodes
    reach, own = (np.linalg.norm(x - x[:, :1], axis=-1) for x in (rest, nodes[13]))
    assert np.abs(own - reach).max() < 0.02 * tolerance * length(shot)


@pytest.fixture
def files(tmp_path):
    """A shot whose target is the groom's own export."""
    shutil.copytree(SAMPLE, tmp_path / "wing")
    path = tmp_path / "wing" / "shot.toml"
    featherfx.export_groom(
        path.parent / "groom.toml", path.parent / "shape.usdc", quality="draft", up_axis="Y",
        meters_per_unit=0.01,
    )  # fmt: skip
    # on the meshes' own grid
    quality = '{ base = "draft", simulated_rows = 11, simulated_columns = 4 }'
    path.write_text(path.read_text().replace('"draft"', quality))
    return path


def with_target(path, text):
    path.write_text(f"{path.read_text()}\n[[target]]\n{text}\n")
    return path


def test_meshes_of_a_file_are_read(files):
    given = featherfx.read_shot(with_target(files, 'shape = "shape.usdc"\nkeys = [[1, 1]]'))
    drawn = drawn_feathers(given)
    for feather, placement in zip(drawn, given.groom.feathers, strict=True):
        own = feather.surface.points(feather.rest) @ placement.rotation.T + placement.position
        assert given.targets[0].points[placement.id] == pytest.approx(own, abs=1e-6)
    given = replace(given, last_frame=3, motion=Motion("hold", {}))
    rest = replace(given, targets=(Target(keys=((1, 1),)),))
    one, other = (moved(each, *each.targets)[0] for each in (given, rest))
    assert one == pytest.approx(other, abs=1e-6)


def curves_file(path, lines):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    for name, line in lines.items():
        curves = UsdGeom.BasisCurves.Define(stage, f"/drawn/{name}")
        curves.CreateTypeAttr("linear")
        curves.CreateCurveVertexCountsAttr([len(line)])
        curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(line.astype(np.float32)))
    stage.Save()


def test_curves_of_a_file_are_read(files):
    """Those of the shafts at rest are the rest shape."""
    plain = replace(featherfx.read_shot(files), last_frame=3)
    lines = {
        placement.id: feather.rest.nodes[:, 0] @ placement.rotation.T + placement.position
        for placement, feather in zip(plain.groom.feathers, drawn_feathers(plain), strict=True)
    }
    curves_file(files.parent / "drawn.usda", lines)
    given = featherfx.read_shot(with_target(files, 'shape = "drawn.usda"\nkeys = [[1, 1]]'))
    assert given.targets[0].lines[FEATHER] == pytest.approx(lines[FEATHER], abs=1e-6)
    rest = Target(keys=((1, 1),))
    one, other = (moved(plain, each)[0] for each in (given.targets[0], rest))
    assert one == pytest.approx(other, abs=1e-4 * length(plain))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda line: line[::-1], "It ends there: is it reversed"),
        (lambda line: line + 9.0, r"begins .* m from its root, more than"),
        (lambda line: line[0] + 3.0 * (line - line[0]), r"is .* m long, its shaft .* m. Draw it"),
    ],
)
def test_a_curve_that_is_no_shaft_is_refused(shot, lines, change, told):
    wrong = {name: change(line) for name, line in lines.items()}
    target = Target(shape="drawn.usda", lines=wrong, frame=14, keys=((1, 1),))
    with pytest.raises(InputError, match=r"target\[0\].shape: the curve of .* " + told) as caught:
        simulate(replace(shot, targets=(target,)))
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_shaft_drawn_as_it_rests_or_the_other_way_keeps_its_vanes(shot, turn):
    feather = drawn_feathers(shot)[0]
    rest = feather.rest.nodes
    line = turn * (rest[:, 0] - rest[0, 0])
    nodes = along_line(feather.rest, feather.station, line).nodes
    sides = [
        np.einsum("nij,nkj->nik", each, each) for each in (rest - rest[:, :1], nodes - nodes[:, :1])
    ]
    np.testing.assert_allclose(sides[1], sides[0], atol=1e-9)
    ways = [np.gradient(each[:, 0], feather.station, axis=0) for each in (rest, nodes)]
    ahead = [
        np.einsum("nij,nj->ni", each - each[:, :1], way)
        for each, way in zip((rest, nodes), ways, strict=True)
    ]
    np.testing.assert_allclose(ahead[1], ahead[0], atol=1e-3 * feather.station[-1])


@pytest.mark.parametrize("off", [0.0, 1e-17, 1e-12, 1e-7, 1e-5])
def test_a_direction_is_turned_into_nearly_its_opposite(off):
    first = np.array([0.0, 0.6, 0.8])
    second = -first + off * np.array([1.0, 0.0, 0.0])
    turn = _shortest(first, second / np.linalg.norm(second))
    np.testing.assert_allclose(turn @ first, second, atol=1e-9)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_another_topology_is_refused(files):
    given = featherfx.read_shot(with_target(files, 'shape = "shape.usdc"\nkeys = [[1, 1]]'))
    finer = replace(given, quality=replace(given.quality, rows=given.quality.rows + 2))
    with pytest.raises(InputError, match=r"target\[0\].shape: '.*' in shape.usdc has \d+ points"):
        simulate(finer)
    fewer = replace(given.targets[0], points={})
    with pytest.raises(InputError, match=r"shape\.usdc has no feather"):
        simulate(replace(given, targets=(fewer,)))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("simulated_columns = 4", "rows = 15, columns = 4", r"'.*' in shape\.usdc has \d+ points"),
        (
            '"shape.usdc"',
            '"drawn.usda"',
            r"drawn\.usda has no feather 'right_.*'\. \d+ more of its",
        ),
    ],
)
def test_check_says_what_a_bake_does_of_shapes_of_other_feathers(files, old, new, told):
    curves_file(files.parent / "drawn.usda", {FEATHER: np.eye(3)})
    path = with_target(files, 'shape = "shape.usdc"\nkeys = [[1, 1]]\nfeathers = "right_primary*"')
    assert featherfx.check(path) == []
    path.write_text(path.read_text().replace(old, new))
    problems = featherfx.check(path)
    with pytest.raises(InputError, match=told) as caught:
        simulate(featherfx.read_shot(path))
    assert list(caught.value.problems) == problems
    assert [each.key for each in problems] == ["target[0].shape"]
    # what is not simulated is led as well
    path.write_text(f'{path.read_text()}\n[[detail]]\nlevel = "rigid"\n')
    assert featherfx.check(path) == problems


def test_check_says_what_a_bake_does_of_channels_that_nothing_feels(files):
    rules = '\n[[channel]]\nname = "{}"\nkeys = [[1, 2]]\n[[detail]]\nlevel = "{}"\n'
    path, text = files, files.read_text()
    for name in ("damping", "follow"):
        path.write_text(text + rules.format(name, "rigid"))
        with pytest.warns(InputWarning, match=rf"channel\[0\]: .* so none feels {name}"):
            assert featherfx.check(path) == []
        path.write_text(text + rules.format(name, "full"))
        with warnings.catch_warnings():
            warnings.simplefilter("error", InputWarning)
            assert featherfx.check(path) == []


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("keys = [[1, 0], [4, 1.5]]", r"target\[0\].keys\[1\]\[1\]: 1.5 is out of range"),
        ("keys = [[4, 0], [4, 1]]", "frame 4 is not later than frame 4"),
        ("keys = [[1, 1]]\nframe = 99", r"target\[0\].frame: 99 is not of the shot"),
        ('keys = [[1, 1]]\nshape = "no.usd"', r"target\[0\].shape: .*no.usd: there is no such"),
        ('keys = [[1, 1]]\nshape = "groom.toml"', "a TOML file"),
        ('keys = [[1, 1]]\nfeathers = "nobody"', "no feather of the groom fits 'nobody'"),
        ("keys = [[1, 1]]\ntolerance = 0", "Give 0.01 to 100"),
        ('keys = [[1, 1]]\nexclude = ["left*", "nobody"]', r"exclude\[1\]: .* fits 'nobody'"),
    ],
)
def test_wrong_targets_are_refused(files, text, told):
    with pytest.raises(InputError, match=told):
        featherfx.read_shot(with_target(files, text))
