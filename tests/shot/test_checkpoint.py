"""Checkpoints: what is saved is what is loaded, and what is none is told."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import at_origin, rod

from featherfx.errors import InputError
from featherfx.shot.loop.simulate import Checkpoint


@pytest.fixture
def saved(tmp_path):
    """A checkpoint of one rod, every array of which differs, and its file."""
    state = at_origin(rod(4))
    for number, array in enumerate(state.arrays().values()):
        array[...] = number
    checkpoint = Checkpoint(
        3, (state,), (state.points.nodes.copy(),), {"contact": {"held": np.arange(2)}}
    )
    checkpoint.save(tmp_path / "state.npz")
    return checkpoint, tmp_path / "state.npz"


def test_what_is_saved_is_loaded(saved):
    checkpoint, path = saved
    again = Checkpoint.load(path)
    assert again.index == checkpoint.index
    loaded = again.states[0].arrays()
    for name, array in checkpoint.states[0].arrays().items():
        np.testing.assert_array_equal(loaded[name], array, err_msg=name)
    np.testing.assert_array_equal(again.starts[0], checkpoint.starts[0])
    np.testing.assert_array_equal(again.stages["contact"]["held"], np.arange(2))


@pytest.mark.parametrize("missing", ["0.rotation", "0.strains.hinge"])
def test_a_checkpoint_without_one_of_the_arrays_of_a_state_is_refused(saved, missing):
    """Such as those of before the strains had names."""
    _, path = saved
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files if name != missing}
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=rf"is no checkpoint: .{missing[2:]}"):
        Checkpoint.load(path)
