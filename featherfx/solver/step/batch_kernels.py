"""Several feathers of a batch through one frame, one after the other, in one call from Python."""

from featherfx.jit.compiled import kernel
from featherfx.solver.step.frame_kernels import advance_feather
from featherfx.solver.step.retry_kernels import scale_settings
from featherfx.solver.step.start_kernels import start_acceleration


@kernel
def advance_feathers(model, loads, feathers, path, state, frame, work, report):
    """Bring feathers (K,) of the state through one frame, in place; those whose steps are yet to
    begin get their accelerations first.

    frame: StepSettings whose coarse is a part of a feather's length. Others as in advance.
    """
    for f in feathers:
        settings = scale_settings(frame, model.length[f])
        if state.step[f] == 0.0:
            start_acceleration(model, loads, f, path, settings, state, work)
        advance_feather(model, loads, f, path, state, settings, work, report)
