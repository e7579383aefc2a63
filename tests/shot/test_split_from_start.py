"""Vanes that are split from the start: they move as torn ones, are drawn open, are preened."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.baking.bake import bake
from featherfx.feather.barb_looks import barb_curves
from featherfx.feather.build import build_feather
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot

SAMPLE = SAMPLES / "feather_pull"
SPLIT = "trailing.splits = { places = [[0.5, 0.9]], width = 0.01 }"
LAST = 8
STROKE = "[[preen]]\nstart = 0.0\nend = 0.2\nmax_gap = 0.05\n"


def write_shot(folder: Path, what: str, more: str = "") -> Path:
    """One barb of a coarse feather is pushed out of the vane; hooks are closed."""
    (folder / "groom.toml").write_text((SAMPLE / "groom.toml").read_text(encoding="utf-8"))
    path = folder / "shot.toml"
    path.write_text(
        f'name = "split"\ngroom = "groom.toml"\nframes = [1, {LAST}]\nmotion = "hold"\n'
        'wind = "calm"\ngravity = [0, 0, 0]\n'
        'quality = { base = "preview", rows = 11, columns = 3, coefficients = 1, '
        "simulated_rows = 11, simulated_columns = 3 }\n"
        + (f'[overrides]\n"*" = {{ {what} }}\n' if what else "")
        + '[[force]]\nfeather = "feather"\nrow = 0.6\ncolumn = 1.0\nside = "trailing"\n'
        "force = [0, 0, 0.02]\nkeys = [[0, 0], [0.2, 1]]\n" + more
    )
    return path


def ends(folder: Path, what: str, more: str = ""):
    """How far (n,) the trailing barbs' ends have risen over the rachis in the last frame, gaps, and
    the report."""
    simulation = simulate(read_shot(write_shot(folder, what, more)))
    nodes = [frame.poses[0].points.nodes for frame in simulation]
    heights = [each[:, 6, 2] - each[:, 0, 2] for each in nodes]
    state = simulation.checkpoint().states[0]
    return heights[-1] - heights[0], state.gaps_of(0), simulation.report.get("hooks")


@pytest.fixture(scope="module")
def split(tmp_path_factory: pytest.TempPathFactory):
    return ends(tmp_path_factory.mktemp("split"), SPLIT)


def test_what_lies_across_a_split_does_not_go_along(split, tmp_path):
    heights, gaps, report = split
    assert (gaps.hooked == 0.0).sum() == 6
    assert report["opened"] == report["healed"] == 0.0
    whole, _, _ = ends(tmp_path, "")
    pushed = int(np.argmax(heights))
    below = np.flatnonzero((gaps.hooked[1] == 0.0).any(axis=(1, 2)))[0]
    assert pushed == below + 1
    assert whole[below] > 0.1 * whole[pushed] > 0.0
    assert heights[below] < 0.5 * whole[below]
    assert heights[pushed] > whole[pushed]


def test_preening_closes_splits_of_vanes_whose_hooks_hold(tmp_path):
    heights, gaps, report = ends(tmp_path, SPLIT, STROKE)
    assert (gaps.hooked == 1.0).all()
    assert report["healed"] > 0.01
    assert np.isfinite(heights).all()


def test_the_mesh_gapes_from_the_first_frame_on_and_checks(tmp_path):
    from pxr import Usd, UsdGeom

    from featherfx.usd.check.check import check_file

    bake(write_shot(tmp_path, SPLIT), tmp_path / "split.usdc", frames=(1, 2), barbs=40)
    assert check_file(tmp_path / "split.usdc") == []
    stage = Usd.Stage.Open(str(tmp_path / "split.usdc"))
    (mesh,) = (UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))
    hooked = np.array(mesh.GetPrim().GetAttribute("primvars:hooked").Get(1))
    assert (hooked == 0.0).sum() == 6
    st = np.array(mesh.GetPrim().GetAttribute("primvars:st").Get())
    _, place = np.unique(st, axis=0, return_inverse=True)
    side = np.array(mesh.GetPrim().GetAttribute("primvars:side").Get())
    vane = np.unique(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)[side < 2])
    for time in (None, 1):
        points = np.array(mesh.GetPointsAttr().Get(*([] if time is None else [time])), dtype=float)
        apart = max(np.ptp(points[vane][place[vane] == k], axis=0).max() for k in place[vane])
        assert apart == pytest.approx(0.01 * 0.2, rel=0.5)


def test_drawn_barbs_gape_with_the_lips(tmp_path):
    """Two neighbours whose ends are apart, at the split; and only there."""
    kind = read_shot(write_shot(tmp_path, SPLIT)).groom.feathers[0].kind
    barbs = barb_curves(kind, (11, 3), 100, False)
    feather = build_feather(kind, 11, 3)
    gaps = np.where(feather.split, 0.0, 1.0)
    trailing = np.flatnonzero(barbs.side == 1)
    apart = np.linalg.norm(np.diff(barbs.points[trailing, -1], axis=0), axis=1)
    beside = apart[1:-1] / (0.5 * (apart[:-2] + apart[2:]))
    assert (beside > 1.5).sum() == 1
    parted = barbs.strands.parted(gaps)
    strip = np.flatnonzero(feather.split[1].any(axis=(1, 2)))[0]
    assert set(parted.near.row) == {strip}
    whole = barbs.points_map(feather.rest).reshape(-1, 3)
    joined = parted.joined(whole, parted.positions(feather.rest))
    np.testing.assert_allclose(joined, barbs.points.reshape(-1, 3), atol=1e-15)
    untouched = np.setdiff1d(np.arange(len(whole)), parted.numbers)
    np.testing.assert_array_equal(joined[untouched], whole[untouched])
