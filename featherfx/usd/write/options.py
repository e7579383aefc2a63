"""Options of written USD for commands and functions; importable without USD.

An option is declared once: its name, type, default and range. The command line derives its own
options from these fields, and errors name them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from featherfx.errors import Problem, require
from featherfx.limits import MAX_FRAMES, MAX_SUBFRAMES, option

LAYOUTS = ("auto", "flat", "payload", "clips")
UP_AXES = ("Y", "Z")
BY_FEATHER, BY_KIND, BY_REGION, AS_ONE = "feather", "kind", "region", "all"
GROUPINGS = (BY_FEATHER, BY_KIND, BY_REGION, AS_ONE)
MESH_FORM, CONDENSED_FORM, CURVES_FORM, BOTH_FORMS = "mesh", "condensed", "curves", "both"
FORMS = (MESH_FORM, CONDENSED_FORM, CURVES_FORM, BOTH_FORMS)
# frames of a chunk; of a shot whose feathers push each other, where a frame may take minutes
CHUNK_FRAMES, CONTACT_CHUNK_FRAMES = 24, 8


@dataclass(frozen=True)
class StageOptions:
    """Options of a USD stage."""

    meters_per_unit: float | None = option(
        None,
        "Unit of length in the USD file; 0.01 for centimetres. Points are converted."
        "  [default: that of the skin's or groom's stage, else 1]",
        above=0.0,
    )
    up_axis: str | None = option(
        None,
        "Axis that points up in the USD file. Points are converted."
        "  [default: that of the skin's or groom's stage, else Z]",
        allowed=UP_AXES,
    )
    layout: str = option(
        "auto",
        "flat: one file; payload: a small root that loads topology and animation as payloads;"
        " clips: the same with animation as value clips; auto: flat up to 256 MB, else clips.",
        allowed=LAYOUTS,
    )
    textures: int | None = option(
        None,
        "Also write the colours as pictures, with N pixels along each feather, for materials and"
        " to paint over.",
        least=32,
        most=2048,
        metavar="N",
    )
    overwrite: bool = option(False, "Replace the output if it exists.")


@dataclass(frozen=True)
class WriteOptions(StageOptions):
    """Options of a cache and its samples."""

    chunk: int | None = option(
        None,
        "Frames written at a time; --resume goes on after the last that is complete."
        f"  [default: {CHUNK_FRAMES}; {CONTACT_CHUNK_FRAMES} where feathers push each other]",
        least=1,
        most=MAX_FRAMES,
    )
    subframes: int = option(1, "Samples per frame, for motion blur.", least=1, most=MAX_SUBFRAMES)
    group: str | None = option(
        None,
        "Which feathers share one mesh: none, those of a kind, of a region, or all. Those without a"
        " region go by kind.  [default: feather up to 200 feathers, region above]",
        allowed=GROUPINGS,
    )
    form: str = option(
        MESH_FORM,
        "Form of a feather in the file. mesh: mesh and rachis; condensed: a curve that carries half"
        " of its rows and barb nodes, as Houdini's condensed feathers, and in small numbers the"
        " rest; curves: rachis and --barbs; both: mesh, and a curve that carries all.",
        allowed=FORMS,
        flag="--as",
    )
    velocities: str | None = option(
        None,
        "full: velocities at every sample; none: leave them out."
        "  [default: none with --as condensed, else full]",
        allowed=("full", "none"),
    )
    accelerations: bool = option(False, "Also write accelerations.")
    diagnostics: Sequence[str] = option(
        (),
        "Also write strain, energy or strain,energy of the vanes, per face and sample.",
        allowed=("strain", "energy"),
    )
    resume: bool = option(
        False,
        "Go on after the frames that an earlier bake of this shot has finished; after a change,"
        " simulate only the feathers that it touches.",
    )

    @property
    def rates(self) -> str:
        """Return how velocities are written, by option or default."""
        none = self.form == CONDENSED_FORM and not self.accelerations
        return self.velocities or ("none" if none else "full")

    @property
    def can_be_taken_over(self) -> bool:
        """Return whether another bake can reuse a feather's samples."""
        return self.form == MESH_FORM and self.rates == "full"


def check_ranges(options: StageOptions) -> None:
    """Raise InputError for every number out of range."""
    problems = []
    for each in fields(options):
        value = getattr(options, each.name)
        least, most = each.metadata.get("least"), each.metadata.get("most")
        if value is None or least is None or least <= value <= (value if most is None else most):
            continue
        allowed = f"at least {least}" if most is None else f"{least} to {most}"
        problems.append(Problem("bake", each.name, f"{value} is not allowed. Give {allowed}"))
    require(*problems)
