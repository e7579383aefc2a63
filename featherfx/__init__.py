"""featherfx: from feather grooms to simulated, time-sampled USD geometry.

`featherfx.bake`, `bake_many`, `check`, `export`, `export_groom`, `join`, `plan` and `retime` do
what the commands of the same kind do; `read_groom`, `read_shot`, `build` and `simulate` are the
steps between; `expand` makes meshes and barbs of condensed feathers. All are loaded when first
asked for, so that `import featherfx` stays light.
docs/usd_in.md, docs/dcc.md and docs/farm.md show them at work.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from featherfx._version import __version__

if TYPE_CHECKING:
    from featherfx.api import build, read_groom, read_quality, read_shot, simulate
    from featherfx.baking.pipeline import bake, check, export, export_groom, join, plan, retime
    from featherfx.farm.bake_many import bake_many
    from featherfx.usd.read.expand import expand

_HOMES = dict.fromkeys(
    ("build", "read_groom", "read_quality", "read_shot", "simulate"), "featherfx.api"
) | dict.fromkeys(
    ("bake", "check", "export", "export_groom", "join", "plan", "retime"),
    "featherfx.baking.pipeline",
)
_HOMES["bake_many"] = "featherfx.farm.bake_many"
_HOMES["expand"] = "featherfx.usd.read.expand"
__all__ = [
    "__version__",
    "bake",
    "bake_many",
    "build",
    "check",
    "expand",
    "export",
    "export_groom",
    "join",
    "plan",
    "read_groom",
    "read_quality",
    "read_shot",
    "retime",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'featherfx' has no attribute '{name}'")
