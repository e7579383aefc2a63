"""Whole tasks from file to file: what the commands do, for programs that import featherfx.

Each is imported, with all that it needs, when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from featherfx.api import read_shot
    from featherfx.baking.accuracy import error_of
    from featherfx.baking.bake import bake
    from featherfx.baking.check import check
    from featherfx.baking.convert import export, join
    from featherfx.baking.groom import export_groom
    from featherfx.baking.plan import plan
    from featherfx.baking.stats import plumage_stats
    from featherfx.usd.check.crossings import count_crossings
    from featherfx.usd.check.outline import measure_holes, measure_moves
    from featherfx.usd.convert.levels import export_levels
    from featherfx.usd.convert.retime import retime
    from featherfx.usd.convert.rigid import export_rigid
    from featherfx.usd.read.inspect import inspect_stage

_HOMES = {
    "bake": "featherfx.baking.bake",
    "check": "featherfx.baking.check",
    "count_crossings": "featherfx.usd.check.crossings",
    "error_of": "featherfx.baking.accuracy",
    "export": "featherfx.baking.convert",
    "export_groom": "featherfx.baking.groom",
    "export_levels": "featherfx.usd.convert.levels",
    "export_rigid": "featherfx.usd.convert.rigid",
    "inspect_stage": "featherfx.usd.read.inspect",
    "join": "featherfx.baking.convert",
    "measure_holes": "featherfx.usd.check.outline",
    "measure_moves": "featherfx.usd.check.outline",
    "plan": "featherfx.baking.plan",
    "plumage_stats": "featherfx.baking.stats",
    "read_shot": "featherfx.api",
    "retime": "featherfx.usd.convert.retime",
}
__all__ = [
    "bake",
    "check",
    "count_crossings",
    "error_of",
    "export",
    "export_groom",
    "export_levels",
    "export_rigid",
    "inspect_stage",
    "join",
    "measure_holes",
    "measure_moves",
    "plan",
    "plumage_stats",
    "read_shot",
    "retime",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
