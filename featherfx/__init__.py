"""featherfx: from feather grooms to simulated, time-sampled USD geometry.

`read_shot` and `read_groom` read files; a `Shot` or `Groom` may be made and changed in memory, too.
`simulate` gives frames as arrays; `bake` writes a cache and opens it, `open_cache` opens an earlier
one. `bake_flock`, `bake_many`, `check`, `stats`, `export`, `export_groom`, `join`, `plan`, `retime`
and `sculpt` do what the commands of the same kind do; `build` and `expand` make meshes. All are
loaded when first asked for, so that `import featherfx` stays light: see docs/python.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from featherfx._version import __version__

if TYPE_CHECKING:
    from featherfx.api import build, read_groom, read_quality, read_shot, simulate
    from featherfx.baking.feather_cache import FeatherCache, FeatherTrack, bake, open_cache
    from featherfx.baking.flock import bake_flock
    from featherfx.baking.pipeline import check, export, export_groom, join, plan, retime, sculpt
    from featherfx.baking.stats import stats
    from featherfx.errors import InputError, InputWarning, SimulationError
    from featherfx.farm.job import bake_many
    from featherfx.feather.types import Feather
    from featherfx.groom.keys.preset import Quality
    from featherfx.groom.types import Groom
    from featherfx.shot.frames import Frame
    from featherfx.shot.loop.simulate import Checkpoint, Simulation
    from featherfx.shot.types import Shot
    from featherfx.usd.read.expand import expand

_HOMES = {
    "api": "build read_groom read_quality read_shot simulate",
    "baking.feather_cache": "FeatherCache FeatherTrack bake open_cache",
    "baking.flock": "bake_flock",
    "baking.pipeline": "check export export_groom join plan retime sculpt",
    "baking.stats": "stats",
    "errors": "InputError InputWarning SimulationError",
    "farm.job": "bake_many",
    "feather.types": "Feather",
    "groom.keys.preset": "Quality",
    "groom.types": "Groom",
    "shot.frames": "Frame",
    "shot.loop.simulate": "Checkpoint Simulation",
    "shot.types": "Shot",
    "usd.read.expand": "expand",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names.split()}
__all__ = [
    "Checkpoint",
    "Feather",
    "FeatherCache",
    "FeatherTrack",
    "Frame",
    "Groom",
    "InputError",
    "InputWarning",
    "Quality",
    "Shot",
    "Simulation",
    "SimulationError",
    "__version__",
    "bake",
    "bake_flock",
    "bake_many",
    "build",
    "check",
    "expand",
    "export",
    "export_groom",
    "join",
    "open_cache",
    "plan",
    "read_groom",
    "read_quality",
    "read_shot",
    "retime",
    "sculpt",
    "simulate",
    "stats",
]


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(f"featherfx.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module 'featherfx' has no attribute '{name}'")


def __dir__() -> list[str]:
    return list(__all__)
