"""USD files opened as they stand on the disk."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from pxr import Tf, Usd

from featherfx.errors import InputError, Problem


def open_stage(path: str | Path) -> Any:
    """Open a USD file with all payloads. Raises InputError if that fails."""
    if not Path(path).is_file():
        fault = "is a folder" if Path(path).is_dir() else "file does not exist"
        raise InputError(Problem(str(path), "", fault))
    if not os.access(path, os.R_OK):
        raise InputError(Problem(str(path), "", "no permission to read it"))
    opened = str(path)
    try:
        stage = Usd.Stage.Open(opened)
        # USD keeps layers that are open elsewhere in this process; the file may be newer. Layers
        # with edits that are not saved belong to the host, and are read as they stand there.
        for layer in stage.GetUsedLayers():
            if not layer.dirty:
                opened = layer.realPath or opened
                layer.Reload()
    except Tf.ErrorException as error:
        reason = "; ".join(str(part.commentary) for part in error.args)
        raise InputError(Problem(opened, "", f"USD cannot open it: {reason}")) from error
    return stage
