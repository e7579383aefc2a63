"""Why a solve ended, as the kernels tell it, and in words."""

from __future__ import annotations

CONVERGED = 0
NOT_CONVERGED = 1
NOT_FINITE = 2
NOT_DEFINITE = 3
# of one feather in one frame, whatever the single steps say
TOO_MUCH_WORK = 4
# of statics in wind
NO_REST = 5
# of statics in wind: at rest, and another start leads to another rest pose
SEVERAL_RESTS = 7
# of a step that Newton has solved
GREW = 6

# Newton iterations of one feather in one frame; bakes of the samples need 3 to 100
MAX_INTERVAL_WORK = 2000

REASONS = {
    NOT_CONVERGED: "Newton did not converge at the shortest step",
    NOT_FINITE: "a value is not finite",
    NOT_DEFINITE: "the linear system is not positive definite",
    NO_REST: "it finds no rest in this wind",
    GREW: "its energy would grow without work being done",
}


def reason_of(status: int, most: int = MAX_INTERVAL_WORK) -> str:
    """Why a feather stopped, in words. most: Newton iterations that it had for a frame."""
    if status == TOO_MUCH_WORK:
        return f"more work than {most} Newton iterations in one frame"
    return REASONS[status]
