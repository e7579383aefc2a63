"""Loose barbs touch each other, and gaps that have opened are no surface to what touches a vane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from featherfx.feather.build import build_feather
from featherfx.groom.types import FeatherKind, Hooked
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import FIBRE_FRACTION, make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.contact.surfaces import as_torn, grids_of, shapes_of, surfaces_of
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state

ROWS, COLUMNS, PUSHED = 25, 3, 12
SWAN = feather_kind("swan_primary")
LOOSE = replace(SWAN, trailing=replace(SWAN.trailing, hooked=Hooked(barb=((0.0, 0.0),))))
OPEN = replace(SWAN, vane_material=replace(SWAN.vane_material, hooks="open"))
FEATHER = build_feather(SWAN, ROWS, COLUMNS)


def normals(nodes: np.ndarray) -> np.ndarray:
    """(n-1, m, 2, 3) of the triangles between barbs of the trailing vane, twice their areas."""
    barbs = np.concatenate([nodes[:, :1], nodes[:, 1 + COLUMNS :]], axis=1)
    edges, ways = np.diff(barbs, axis=1), barbs[1:] - barbs[:-1]
    return np.stack([np.cross(edges[:-1], ways[:, :-1]), np.cross(edges[1:], ways[:, 1:])], axis=2)


def nearest(before: np.ndarray, after: np.ndarray) -> float:
    """Least distance of two neighbouring barbs over that at rest, where they go straight from one
    pose to the next."""
    start, change = normals(before), normals(after) - normals(before)
    square = np.einsum("...k,...k", change, change)
    part = -np.einsum("...k,...k", start, change) / np.where(square > 0.0, square, 1.0)
    least = np.linalg.norm(start + np.clip(part, 0.0, 1.0)[..., None] * change, axis=-1)
    rest = np.linalg.norm(normals(FEATHER.rest.nodes), axis=-1)
    return float((least[rest > 0.0] / rest[rest > 0.0]).min())


def pushed(force: float, kind: FeatherKind = LOOSE, *, touching: bool) -> tuple[float, np.ndarray]:
    """How near to each other barbs come, and their nodes, when the end of one is pushed towards
    the next ones (N), for a twentieth of a second; those of a hooked vane are all torn apart."""
    model = make_model([FEATHER], [kind], 1, touching=touching)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    if model.hooked:
        state.gaps.hooked[0, 1] = 0.0
    loads = no_loads(1)._replace(force=np.zeros((1, *model.mass.shape[1:], 3)))
    loads.force[0, PUSHED, -1, 0] = force
    least = 1.0
    with Solver(model, Settings(tolerance=1e-4), 1) as solver:
        for _ in range(50):
            before = state.points.nodes[0].copy()
            report = solver.advance(state, loads, hold_roots(state), 0.001)
            assert report.status[0] == 0
            least = min(least, nearest(before, state.points.nodes[0]))
    return least, state.points.nodes[0]


@pytest.mark.parametrize("force", [1e-3, 1e-2])
def test_loose_barbs_do_not_pass_through_each_other(force: float):
    """Pressed together they yield by less than half of the width at which they touch."""
    assert pushed(force, touching=False)[0] < 0.02
    least, nodes = pushed(force, touching=True)
    assert least > 0.5 * FIBRE_FRACTION
    # the next one is pushed aside, the one behind is not
    moved = np.linalg.norm(nodes - FEATHER.rest.nodes, axis=2)[:, -1]
    assert moved[PUSHED + 1] > 1e-3
    assert moved[PUSHED - 1] < 0.5 * moved[PUSHED + 1]


def test_a_step_in_which_loose_barbs_pass_is_no_error():
    """Where none shorter is allowed it is taken and counted, with the error that it has."""
    model = make_model([FEATHER], [LOOSE], 1, touching=True)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    loads = no_loads(1)._replace(force=np.zeros((1, *model.mass.shape[1:], 3)))
    loads.force[0, PUSHED, -1, 0] = 1e-2
    for most, passed in ((1, 1.0), (16, 0.0)):
        settings = Settings(tolerance=0.05, max_substeps=most)
        with Solver(model, settings, 1) as solver:
            report = solver.advance(state.copy(), loads, hold_roots(state), 0.01)
        assert (report.passed[0], report.forced[0]) == (passed, 0.0)
        assert report.error[0] < settings.tolerance
        assert report.too_long()[0] == (passed > 0.0)


def test_loose_barbs_that_do_not_touch_feel_nothing():
    free, touching = (pushed(1e-4, touching=each) for each in (False, True))
    np.testing.assert_array_equal(free[1], touching[1])


def test_barbs_of_a_torn_vane_do_not_pass_through_each_other():
    assert pushed(1e-2, OPEN, touching=False)[0] > 0.5 * FIBRE_FRACTION


@pytest.mark.parametrize(("side", "rim"), [(0, slice(-3, None)), (1, slice(-6, -3))])
def test_what_spans_an_open_gap_touches_nothing(side: int, rim: slice):
    model = make_model([FEATHER], [OPEN], 1)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    grids = grids_of([model])
    whole = surfaces_of(shapes_of([model]), grids, [6e-5])
    state.gaps.hooked[0, side, PUSHED] = 0.0
    torn = as_torn(whole, grids, [model], [state])
    gone = whole.exists[0] != torn.exists[0]
    np.testing.assert_array_equal(gone[side, PUSHED], whole.exists[0, side, PUSHED] != 0)
    assert gone.sum() == gone[side, PUSHED].sum() > 0
    lost = whole.guests[0] != torn.guests[0]
    assert lost[PUSHED, rim].all()
    assert lost.sum() == 3
