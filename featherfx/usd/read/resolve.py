"""Files that are named as assets: found beside who names them, or by USD's asset resolver."""

from __future__ import annotations

from pathlib import Path

from pxr import Ar

from featherfx.usd.installed import refuse_unfit_usd


def located(folder: Path, name: str) -> Path:
    """Where a file is that is named by someone in a folder.

    What is there as seen from the folder is that; else the resolver of this process is asked, which
    knows search paths (PXR_AR_DEFAULT_SEARCH_PATH) and, where a studio has its own, addresses such
    as asset:bird. What it does not find either is as seen from the folder.
    """
    own = folder / name
    if own.exists():
        return own
    refuse_unfit_usd()
    resolver = Ar.GetResolver()
    beside = str(folder.absolute() / "shot.usda")  # need not be there
    context = resolver.CreateDefaultContextForAsset(beside)
    with Ar.ResolverContextBinder(context):
        asked = resolver.CreateIdentifier(name, Ar.ResolvedPath(beside))
        found = resolver.Resolve(asked).GetPathString()
    return Path(found) if found else own
