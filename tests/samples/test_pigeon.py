"""The pigeon: its skin, how it walks, and its plumage."""

import importlib
from collections import Counter

import numpy as np
import pytest
from crossed import crossed
from places import SAMPLES
from pxr import Usd, UsdGeom
from scipy.spatial import cKDTree

from featherfx.api import scene_readers
from featherfx.baking.pipeline import bake, check
from featherfx.errors import InputWarning
from featherfx.feather.placed_feathers import build_feathers
from featherfx.groom.keys.anatomy import TRACTS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.read.read import read_groom as read_placed
from featherfx.groom.skin.points import signed_volume, skin_doubts
from featherfx.shot.loop.placement import lay_out
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.stage import open_scene
from featherfx.usd.read.surface import MeshOptions, open_mesh

PIGEON = SAMPLES / "pigeon"


def skin_of(path):
    place = Place("", "", Problems())
    return open_mesh(open_scene(path, place), "/pigeon/body", MeshOptions(), place)


@pytest.fixture(scope="module")
def skin():
    return skin_of(PIGEON / "body.usdc")


@pytest.fixture(scope="module")
def groom():
    """As placed, before its layout."""
    return read_placed(PIGEON / "groom.toml", (), scene_readers())


def test_the_skin_is_closed_and_does_not_cross_itself(skin):
    assert skin_doubts(skin) == []
    # m^3: a plump bird, 35 cm long
    assert 5e-4 < signed_volume(skin.rest[skin.triangles]) < 3e-3
    assert check(PIGEON / "body.usdc") == []


@pytest.fixture(scope="module")
def maker():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PIGEON)  # as of a script that is run
        return importlib.import_module("make_body")


@pytest.fixture(scope="module")
def body_of(maker, tmp_path_factory):
    """File of the body of another bird, made once."""
    folder = tmp_path_factory.mktemp("bodies")

    def made(bird):
        path = folder / f"{bird}.usdc"
        if not path.exists():
            maker.make(path, bird)
        return path

    return made


OTHERS = ["sparrow", "parrot", "peacock", "swan", "ostrich"]
OTHERS = [pytest.param(each, marks=pytest.mark.nightly) for each in OTHERS]


@pytest.mark.parametrize("bird", ["gull", "owl", "owl_flying", *OTHERS])
def test_bodies_of_other_birds_are_whole(maker, body_of, bird):
    made = skin_of(body_of(bird))
    assert skin_doubts(made) == []
    # landmarks are near it, those of the eyes before it
    for name, place in maker.landmarks(maker.BUILDS[bird]).items():
        if "eye" not in name:
            near = np.linalg.norm(made.rest - place, axis=1).min()
            assert near < 0.03 * maker.BUILDS[bird].size, name


def test_bills_hook_over_as_their_build_says(maker):
    bodies = importlib.import_module("bodies")
    for bird in ("parrot", "gull"):
        build = maker.BUILDS[bird]
        path = bodies.bill(build)
        ways = np.diff(path, axis=0) @ ((1, 0), (0, 0), (0, 1))
        turned = np.degrees(np.arctan2(-ways[:, 1], ways[:, 0]))
        steps = build.hook * (len(ways) - 1) / len(ways)
        assert turned[-1] - turned[0] == pytest.approx(steps)
        assert (maker.distance(path[:-1], build) < 0.0).all()
        assert (maker.distance(path[-1:] + 0.004, build) > 0.0).all()


def test_coverts_below_the_owls_tail_are_rooted_outside_its_body(maker, body_of, tmp_path):
    """Those that stand within the end of its rump pass through the skin there."""
    body = body_of("owl").as_posix()
    build = maker.BUILDS["owl"]
    bare = ", ".join(f"tracts.{part}.relative_density = 0" for part in TRACTS)
    places = maker.landmarks(build).items()
    (tmp_path / "groom.toml").write_text(
        f'name = "owl"\n[skin]\nusd = "{body}"\nprim = "/pigeon/body"\n[bird]\nfold = 0\n'
        + f'type = {{ base = "owl", disc.radius = 0, {bare} }}\n[bird.landmarks]\n'
        + "".join(f"{name} = {place.tolist()}\n" for name, place in places)
    )
    found = read_placed(tmp_path / "groom.toml", (), scene_readers())
    roots = np.array([f.position for f in found.feathers if "under_tail_covert" in f.id])
    assert len(roots) == 36
    assert maker.distance(roots / build.size, build).min() > 0.0


def test_the_script_makes_the_owl_in_flight(body_of):
    files = body_of("owl_flying"), SAMPLES / "owl_flight" / "body.usdc"
    made, kept = map(skin_of, files)
    assert np.abs(made.rest - kept.rest).max() < 1e-6


def test_the_script_makes_the_skin_that_is_there(skin, maker, tmp_path):
    maker.make(tmp_path / "body.usdc")
    made = skin_of(tmp_path / "body.usdc")
    assert np.abs(made.rest - skin.rest).max() < 1e-6
    for code in (1.0, 40.0, 96.0):
        assert np.abs(made.points(code) - skin.points(code)).max() < 1e-5


def test_toes_end_in_claws_that_go_with_the_legs(skin):
    claw_mesh = open_mesh(
        open_scene(PIGEON / "body.usdc", Place("", "", Problems())),
        "/pigeon/claws",
        MeshOptions(),
        Place("", "", Problems()),
    )
    claws, feet = claw_mesh.rest, skin.rest[skin.rest[:, 2] < 0.06]
    assert claws[:, 0].max() > feet[:, 0].max() + 5e-3
    assert feet[:, 2].min() - 5e-4 < claws[:, 2].min()
    near, _ = cKDTree(feet).query(claws)
    assert near.max() < 0.012
    moved, _ = cKDTree(skin.points(40.0)).query(claw_mesh.points(40.0))
    assert np.abs(moved - cKDTree(skin.rest).query(claws)[0]).max() < 2e-3
    assert np.linalg.norm(claw_mesh.points(40.0) - claws, axis=1).max() > 5e-3


def test_it_stands_then_walks_with_a_nodding_head(skin):
    rest = skin.points(1.0)
    assert np.abs(skin.points(1.0) - skin.rest).max() < 1e-3
    poses = np.array([skin.points(float(code)) for code in range(1, 97)])
    speeds = np.linalg.norm(np.diff(poses, axis=0), axis=2).max(axis=1)
    assert speeds[0] < 0.1 * speeds.max()
    head, tail = rest[:, 0].argmax(), rest[:, 0].argmin()
    swing = np.ptp(poses[48:, head, 0])
    assert 0.01 < swing < 0.05
    assert np.ptp(poses[48:, tail, 0]) < 0.5 * swing


def test_more_than_two_thousand_feathers_in_regions(groom):
    regions = Counter(feather.region for feather in groom.feathers)
    assert sum(regions.values()) >= 2000
    wanted = {"crown", "nape", "breast", "back", "greater_coverts", "primaries", "tail"}
    assert wanted <= regions.keys()
    assert min(regions[name] for name in wanted) >= 12


def test_feathers_of_a_folded_wing_do_not_cross(groom):
    wing = [f for f in groom.feathers if f.id.startswith("right_wing")]
    assert len(wing) > 75
    # the small coverts are coat, which lies over each other without a layout
    assert crossed([f for f in wing if "lesser" not in f.id]) == []


@pytest.fixture(scope="module")
def laid(groom):
    with pytest.warns(InputWarning, match="flow is singular"):
        return lay_out(groom)


def test_contour_feathers_lie_flat_and_keep_apart(groom, laid):
    """A real breast lies at 5 to 10 degrees to the skin."""
    own = [f for f in laid.feathers if f.leaf is not None]
    assert len(own) > 1850
    assert [f.id for f in laid.feathers] == [f.id for f in groom.feathers]
    built = build_feathers(own, 21, 6)
    angles, heights = [], []
    tree, normals = cKDTree(laid.coat.coat.rest.points), laid.coat.coat.rest.normals[:, :3]
    for placement, feather in zip(own, built, strict=True):
        line = feather.rest.nodes[:, 0] @ placement.rotation.T + placement.position
        _, near = tree.query(line[[10, -1]])
        way = (line[11] - line[9]) / np.linalg.norm(line[11] - line[9])
        angles.append(np.degrees(np.arcsin(way @ normals[near[0]])))
        height = (line[-1] - tree.data[near[1]]) @ normals[near[1]]
        heights.append(height / feather.station[-1])
    assert 3.0 < np.median(np.abs(angles)) < 6.0
    assert np.percentile(np.abs(angles), 90) < 12.0
    assert np.percentile(heights, 90) < 0.12


def test_a_laid_out_coat_does_not_cross(groom, laid):
    def some(whole):
        return [f for f in whole.feathers if f.region in ("nape", "crown", "breast")]

    assert len(crossed(some(groom), 21, 6)) > 300
    assert len(crossed(some(laid), 21, 6)) < 0.01 * len(some(laid))


def test_scapulars_lie_over_the_coverts_of_a_folded_wing(laid):
    parts = "scapular", "median_coverts"
    own = {f.id: f for f in laid.feathers if f.region in parts or "lesser" in f.id}
    pairs = crossed(list(own.values()), 21, 6)
    assert sum((own[a].leaf is None) != (own[b].leaf is None) for a, b in pairs) < 4


@pytest.mark.slow
@pytest.mark.parametrize("group", ["all", None])
def test_many_feathers_share_few_prims(tmp_path, group):
    """Without being told so they are grouped by region."""
    path = tmp_path / "pigeon.usdc"
    with pytest.warns(InputWarning, match="layout"):
        report = bake(PIGEON / "shot.toml", path, frames=(1, 1), group=group)
    cache, stage = Cache(path), Usd.Stage.Open(str(path))
    assert len({f.id for f in cache.feathers}) == report["feathers"] > 2000
    wanted = 1 if group else len({f.region for f in cache.feathers})
    for schema in (UsdGeom.Mesh, UsdGeom.BasisCurves):
        assert sum(prim.IsA(schema) for prim in stage.Traverse()) == wanted
    assert check(path) == []
