"""Whole tasks from file to file: what the commands do, for programs that import featherfx.

Each is imported, with all that it needs, when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from featherfx.files.process import seldom_collected

if TYPE_CHECKING:
    from featherfx.api import read_shot as read_shot
    from featherfx.baking.accuracy import error_of as error_of
    from featherfx.baking.bake import bake as bake
    from featherfx.baking.check import check as check
    from featherfx.baking.check import explain_options as explain_options
    from featherfx.baking.check import explained_lines as explained_lines
    from featherfx.baking.export import export as export
    from featherfx.baking.export import export_groom as export_groom
    from featherfx.baking.export import measure_coverage as measure_coverage
    from featherfx.baking.flock import bake_flock as bake_flock
    from featherfx.baking.plan import join as join
    from featherfx.baking.plan import plan as plan
    from featherfx.baking.stats import stats as stats
    from featherfx.usd.check.check import is_cache as is_cache
    from featherfx.usd.check.check import judge_complete_cache as judge_complete_cache
    from featherfx.usd.check.measures import count_crossings as count_crossings
    from featherfx.usd.check.measures import measure_plumage as measure_plumage
    from featherfx.usd.convert.levels import export_levels as export_levels
    from featherfx.usd.convert.retime import retime as retime
    from featherfx.usd.convert.rigid import export_rigid as export_rigid
    from featherfx.usd.convert.sculpt import sculpt as sculpt
    from featherfx.usd.read.contents import inspect_stage as inspect_stage

_HOMES = {
    "api": "read_shot",
    "baking.accuracy": "error_of",
    "baking.bake": "bake",
    "baking.check": "check explain_options explained_lines",
    "baking.export": "export export_groom measure_coverage",
    "baking.flock": "bake_flock",
    "baking.plan": "join plan",
    "baking.stats": "stats",
    "usd.check.check": "is_cache judge_complete_cache",
    "usd.check.measures": "count_crossings measure_plumage",
    "usd.convert.levels": "export_levels",
    "usd.convert.retime": "retime",
    "usd.convert.rigid": "export_rigid",
    "usd.convert.sculpt": "sculpt",
    "usd.read.contents": "inspect_stage",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        # all of what is loaded stays
        with seldom_collected():
            return getattr(import_module(f"featherfx.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
