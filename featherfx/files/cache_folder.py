"""The folder for what may be made again: $FEATHERFX_CACHE, else the system's own of a user."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

from featherfx.files.trust import distrust


def wanted_folder() -> Path:
    """The folder that is asked for; on Linux by default ~/.cache/featherfx."""
    asked = os.environ.get("FEATHERFX_CACHE")
    return Path(asked) if asked else platformdirs.user_cache_path("featherfx", appauthor=False)


def doubt(folder: Path) -> str:
    """Why nothing may be loaded from a folder, in words; empty if it is trusted (trust.py), or
    $FEATHERFX_TRUSTED_CACHE names it. Raises OSError where it cannot be looked at."""
    named = os.environ.get("FEATHERFX_TRUSTED_CACHE")
    fault = "" if named and Path(named) == folder else distrust(folder)
    return f"{fault}; FEATHERFX_TRUSTED_CACHE={folder} would trust it" if fault else ""
