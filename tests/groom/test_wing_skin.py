"""Wings that a coarse skin has: rows of feathers lie on it, and the coat leaves it out."""

import warnings

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from scipy.spatial import cKDTree

from featherfx.algebra.vectors import face_products
from featherfx.api import scene_readers
from featherfx.errors import InputWarning
from featherfx.feather.placed_feathers import build_feathers
from featherfx.groom.read.read import read_groom
from featherfx.groom.skin.points import within

# a bird that flies to -y with its neck stretched out: y, z and radius of sections of 8 corners, m
TRUNK = [(-0.62, 0.02, 0.008), (-0.55, 0.02, 0.03), (-0.48, 0.03, 0.03), (-0.2, 0.0, 0.025),
         (-0.14, 0.0, 0.07), (0.0, 0.0, 0.1), (0.18, 0.01, 0.07), (0.27, 0.02, 0.02)]  # fmt: skip
# of wings half spread, that rise and sweep back: x, y and z of leading edges, and chords, m
WING = [(0.05, -0.12, 0.05, 0.17), (0.2, -0.16, 0.12, 0.2), (0.36, -0.14, 0.16, 0.22),
        (0.5, -0.06, 0.15, 0.18), (0.62, 0.06, 0.12, 0.09), (0.66, 0.12, 0.11, 0.02)]  # fmt: skip
THICK = 0.1  # of the chord
LANDMARKS = """beak = [0, -0.62, 0.02]
crown = [0, -0.53, 0.05]
nape = [0, -0.47, 0.06]
breast = [0, -0.12, -0.07]
right_shoulder = [-0.06, -0.08, 0.055]
left_shoulder = [0.06, -0.08, 0.055]
vent = [0, 0.16, -0.06]
tail = [0, 0.22, 0.03]
right_wing = [[-0.2, -0.08, 0.12], [-0.36, -0.09, 0.16], [-0.62, 0.08, 0.12]]
left_wing = [[0.2, -0.08, 0.12], [0.36, -0.09, 0.16], [0.62, 0.08, 0.12]]
"""


def tube(rings):
    """Points and quads of a closed tube of rings (K, n, 3)."""
    count = rings.shape[1]
    faces = [[range(count)[::-1], range(count * (len(rings) - 1), count * len(rings))]]
    step = np.arange(count)
    for k in range(len(rings) - 1):
        a, b = k * count + step, k * count + np.roll(step, -1)
        faces.append(np.stack([a, b, b + count, a + count], axis=1).tolist())
    return rings.reshape(-1, 3), [list(map(int, face)) for part in faces for face in part]


def make_bird(path, wings):
    turns = 2 * np.pi * np.arange(8) / 8
    trunk = [[(r * np.cos(t), y, z + r * np.sin(t)) for t in turns] for y, z, r in TRUNK]
    parts = [tube(np.array(trunk)[:, ::-1])]
    sections = np.array(
        [[(x, y, z), (x, y + 0.4 * c, z + THICK * c), (x, y + c, z), (x, y + 0.4 * c, z - 0.02 * c)]
         for x, y, z, c in WING]
    )  # fmt: skip
    for sign in wings:
        parts.append(tube((sections * (sign, 1, 1))[:, ::sign]))
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Z")
    mesh = UsdGeom.Mesh.Define(stage, "/bird")
    stage.SetDefaultPrim(mesh.GetPrim())
    first = np.cumsum([0, *(len(points) for points, _ in parts)])
    mesh.CreatePointsAttr(np.concatenate([points for points, _ in parts]).astype(np.float32))
    faces = [
        [n + at for n in face] for (_, own), at in zip(parts, first, strict=False) for face in own
    ]
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([int(n) for face in faces for n in face])
    mesh.CreateSubdivisionSchemeAttr("none")
    stage.Save()


def groom_of(folder, wings=(1, -1)):
    write_groom(folder, wings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # its parts pass through each other
        return read_groom(folder / "groom.toml", (), scene_readers())


def write_groom(folder, wings):
    make_bird(folder / "bird.usda", wings)
    text = (
        'name = "bird"\n[skin]\nusd = "bird.usda"\nprim = "/bird"\n[space]\nof = "skin"\n'
        f'left = "x"\n[bird]\ntype = "gull"\nup = [0, 0, 1]\n[bird.landmarks]\n{LANDMARKS}'
    )
    (folder / "groom.toml").write_text(text)


@pytest.fixture(scope="module")
def groom(tmp_path_factory):
    return groom_of(tmp_path_factory.mktemp("bird"))


def rachises(feathers):
    built = build_feathers(feathers, 11, 2)
    return [
        feather.position + shape.rest.nodes[2:, 0] @ feather.rotation.T
        for feather, shape in zip(feathers, built, strict=True)
    ]


def test_rows_lie_on_the_skin_of_wings_and_none_within(groom):
    rows = [f for f in groom.feathers if f.turning is not None and "_wing_" in f.id]
    lines = np.concatenate(rachises(rows))
    assert signed(groom.skin) > 0.0
    assert not within(lines, groom.skin).any()
    # nearer than a sixth of the chord: the plane of the bones is up to 60 mm off
    corners = groom.skin
    places = np.concatenate([corners.mean(axis=1), corners.reshape(-1, 3)])
    roots = np.array([f.position for f in rows if "covert" in f.region])
    grid = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8
    places = np.einsum("kc,tcx->tkx", grid, corners).reshape(-1, 3)
    assert np.percentile(cKDTree(places).query(roots)[0], 95) < 0.03


def signed(corners):
    return float(np.einsum("tc,tc->", face_products(corners), corners[:, 0]))


def test_flight_feathers_and_those_below_end_at_the_edge_behind(groom):
    trail = np.array([(x, y + c) for x, y, _, c in WING])
    for region in ("secondaries", "under_greater_coverts"):
        own = [f for f in groom.feathers if f.region == region and f.id.startswith("left")]
        tips = np.array([line[-1] for line in rachises(own)])
        beyond = tips[:, 1] - np.interp(tips[:, 0], *trail.T)
        assert np.abs(np.median(beyond)) < 0.02
        assert beyond.max() < 0.04


def test_the_coat_of_the_body_leaves_wings_to_their_rows_and_small_coverts(groom):
    far = [f for f in groom.feathers if abs(f.position[0]) > 0.2]
    regions = {f.region for f in far}
    assert not regions & {"breast", "scapular", "flank", "mantle", "back", "rump"}
    front = [f for f in far if f.region == "left_wing_lesser_covert_1"]
    assert len(front) > 50
    lead = np.array([(x, y) for x, y, _, _ in WING])
    behind = [f.position[1] - np.interp(f.position[0], *lead.T) for f in front]
    assert np.max(behind) < 0.12


def test_small_coverts_lie_outwards_over_the_front(groom):
    for side, sign in (("left", 1.0), ("right", -1.0)):
        own = [f for f in groom.feathers if f.region == f"{side}_wing_lesser_covert_1"]
        assert np.mean([sign * f.rotation[0, 0] > 0.2 for f in own]) > 0.9


def test_a_body_without_wings_has_those_of_its_type(tmp_path):
    bird = groom_of(tmp_path, wings=())
    assert {"alula", "lesser_covert_1s"} <= {f.region for f in bird.feathers}


def test_a_skin_with_one_wing_is_told(tmp_path):
    write_groom(tmp_path, (1,))
    with pytest.warns(InputWarning) as told:
        bird = read_groom(tmp_path / "groom.toml", (), scene_readers())
    said = [str(each.message) for each in told if "wing beneath" in str(each.message)]
    assert len(said) == 1
    assert "bird: the skin has no right wing beneath its flight feathers" in said[0]
    assert {"alula", "lesser_covert_1s"} <= {f.region for f in bird.feathers}
