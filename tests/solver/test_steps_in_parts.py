"""Steps that are solved in parts where Newton does not reach the whole at once."""

import numpy as np
import pytest
from trial_batches import at_origin, preset_batch

from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import (
    RootPath,
    Settings,
    expand_wind,
    hold_roots,
    make_report,
    make_scratch,
    step_settings,
)
from featherfx.solver.step.frame_kernels import advance_feathers
from featherfx.solver.types import CONVERGED

FRAME = 1.0 / 24.0
# iterations that the step takes from the rigidly moved pose, and fewer
ENOUGH, TOO_FEW = 32, 8


def turned(iterations):
    """A feather whose root turns by 2 rad in one step, of so many iterations at most, and its
    report."""
    _, model = preset_batch("swan_primary", rows=9, columns=4, coefficients=2)
    state, report = at_origin(model), make_report(1)
    path = hold_roots(state)
    samples = np.zeros((1, 5, 6))
    samples[0, :, 5] = np.linspace(0.0, 2.0, 5)
    settings = Settings(tolerance=1e30, newton=1e-9, max_substeps=1)
    frame = step_settings(settings, FRAME)._replace(iterations=iterations, coarse=1e30)
    loads, path, one = expand_wind(no_loads(1), 1), RootPath(samples, path.base), np.array([0])
    advance_feathers(model, loads, one, path, state, frame, make_scratch(model), report)
    assert report.status[0] == CONVERGED
    return state, report


def test_a_step_in_parts_ends_where_the_whole_one_does():
    (whole, at_once), (state, report) = turned(ENOUGH), turned(TOO_FEW)
    assert at_once.iterations[0] > TOO_FEW
    assert report.steps[0] == 1
    assert report.failed[0] == 0
    assert report.iterations[0] > TOO_FEW
    assert state.points.nodes == pytest.approx(whole.points.nodes, abs=1e-7)
