"""USD: caches that are written, and caches, grooms and scenes that are read.

Change here: what is in a USD file.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from featherfx.usd.check import judge as judge
    from featherfx.usd.read import expand as expand
    from featherfx.usd.read import stage as stage
    from featherfx.usd.read import values as values
    from featherfx.usd.write import forms as forms
    from featherfx.usd.write import materials as materials
    from featherfx.usd.write import previous_cache as previous_cache

_MODULES = {
    "forms": "write.forms",  # --as condensed, --as both
    "expand": "read.expand",  # caches of condensed feathers
    "judge": "check.judge",  # caches that are written
    "values": "read.values",  # skins, grooms and scenery of USD files
    "previous_cache": "write.previous_cache",  # --resume, or a cache at the output
    "stage": "read.stage",  # skins, grooms and scenery of USD files
    "materials": "write.materials",  # --textures, and iridescent feathers
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"{__name__}.{_MODULES[name]}")
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
