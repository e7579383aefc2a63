"""Assembled gradient and Hessian of a step's energy, and what a rigid motion does to them."""

from __future__ import annotations

from pathlib import Path
import sys

import numpy as np
import pytest
from derivatives import derivative_fault, with_a_wrong_sign
from trial_batches import (
    FEATHER_PRESETS,
    at_origin,
    preset_batch,
    random_pose,
    random_turn,
    rotation_of,
    turned,
)

from featherfx.mechanics.model import no_loads
from featherfx.mechanics.turns import turns_to_frames
from featherfx.solver.assembly_kernels import assemble
from featherfx.solver.newton_kernels import evaluate
from featherfx.solver.pose_kernels import add_increment, barb_jacobians, load_pose
from featherfx.solver.work import make_work
