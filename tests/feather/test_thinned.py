"""Nodes that are left out of condensed feathers follow those that are kept."""

import numpy as np
import pytest
from places import SAMPLES
from scipy.spatial.transform import Rotation

import featherfx
from featherfx.feather.build import build_feather
from featherfx.feather.detail import choose_rows_and_nodes, detail_of, restored
from featherfx.feather.types import RowPoints, stacked


@pytest.fixture(scope="module")
def feather():
    groom = featherfx.read_groom(SAMPLES / "swan_wing" / "groom.toml")
    return build_feather(groom.feathers[0].kind, 21, 6)


def turned_rows(feather, vectors):
    """Two poses: rows that turn along the feather by rotation vectors (2, 3), barbs with them."""
    share = (feather.station / feather.station[-1])[:, None]
    poses = []
    for vector in vectors:
        turns = Rotation.from_rotvec(share * vector).as_matrix()
        nodes, directors = feather.rest.nodes, feather.rest.directors
        root = nodes[:, :1] @ Rotation.from_rotvec(vector).as_matrix().T
        away = np.einsum("rij,rnj->rni", turns, nodes - nodes[:, :1])
        poses.append(RowPoints(root + away, np.einsum("rij,rdj->rdi", turns, directors)))
    return poses


def missed(feather, poses):
    """Detail of poses, and the largest error over the length of what it gives back."""
    thin = choose_rows_and_nodes(feather.rows, feather.columns)
    rest, lengths = [feather.rest] * len(poses), np.full(len(poses), feather.station[-1])
    detail = detail_of(poses, rest, lengths, thin)
    whole = stacked(poses)
    found = restored(thin.select(whole), stacked(rest), lengths, detail, thin)
    return detail, np.abs(found.nodes - whole.nodes).max() / feather.station[-1], found


def test_rigid_motions_leave_nothing_to_tell(feather):
    turn = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
    pose = RowPoints(
        feather.rest.nodes @ turn.T + [1.0, 2.0, -3.0], feather.rest.directors @ turn.T
    )
    detail, error, found = missed(feather, [pose])
    assert not detail.any()
    assert error < 1e-12
    assert found.directors[0] == pytest.approx(pose.directors, abs=1e-12)


def test_what_is_told_is_within_half_a_step(feather):
    """Steps are 7.5e-4 of the length along each axis; half a diagonal is 6.5e-4."""
    poses = turned_rows(feather, np.array([[0.9, 0.2, -0.4], [-0.3, 1.2, 0.5]]))
    noise = np.random.default_rng(3).normal(0.0, 0.01, (2, *poses[0].nodes.shape))
    noise[:, :, 0] = 0.0
    poses = [
        RowPoints(p.nodes + feather.station[-1] * n, p.directors)
        for p, n in zip(poses, noise, strict=True)
    ]
    detail, error, _ = missed(feather, poses)
    assert detail.any()
    assert error <= 0.5 * 7.5e-4 * 3**0.5 + 1e-9


def test_feathers_do_not_depend_on_who_else_is_asked_for(feather):
    poses = turned_rows(feather, np.array([[0.9, 0.2, -0.4], [-0.3, 1.2, 0.5]]))
    _, _, both = missed(feather, poses)
    _, _, one = missed(feather, poses[1:])
    assert np.array_equal(both.nodes[1], one.nodes[0])
