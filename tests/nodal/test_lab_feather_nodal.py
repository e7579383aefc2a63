"""`featherfx lab feather --kinematics nodal` beside the default kinematics."""

import json

import numpy as np
import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.lab.feather import FeatherTest, run_feather

TEST = (
    *("lab", "feather", "--preset", "swan_primary", "--rows", "9", "--columns", "3"),
    *("--pull", "0,0,0.02", "--duration", "0.125", "--json"),
)


def values(kinematics):
    result = invoke(*TEST, "--kinematics", kinematics)
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.slow
def test_nodal_gives_the_same_keys_and_nearly_the_same_feather():
    smooth, nodal = values("barb-curvature"), values("nodal")
    assert list(smooth) == list(nodal)
    gap = np.linalg.norm(np.subtract(smooth["points"], nodal["points"]), axis=-1)
    assert gap.max() < 2e-3
    assert nodal["unknowns"] > smooth["unknowns"]
    assert smooth["barb_strain_max"] < 1e-12 < nodal["barb_strain_max"] < 1e-4
    for found in (smooth, nodal):
        assert found["seconds_assembly"] > 0.0
        assert found["steps"] >= 3


def test_unknown_kinematics_is_named():
    with pytest.raises(InputError, match="kinematics"):
        run_feather(FeatherTest("swan_primary", 0.1, kinematics="rigid"))


def test_hooks_that_may_open_are_refused(tmp_path):
    folder = tmp_path / "feather"
    folder.mkdir()
    (folder / "torn.toml").write_text('base = "swan_primary"\nvane_material.hooks = "open"\n')
    with pytest.raises(InputError, match=r"vane_material\.hooks: the nodal kinematics has no gaps"):
        run_feather(FeatherTest("torn", 0.1, kinematics="nodal"), (tmp_path,))
