"""A cache as one plain USD file, and how other files of it begin and end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import Sdf

from featherfx.files.atomic_write import standing
from featherfx.usd.read.opening import open_stage
from featherfx.usd.read.stage import refuse_inputs
from featherfx.usd.read.values import computed
from featherfx.usd.write.output import check_output
from featherfx.usd.write.publish import publish

Publish = Callable[[Any], Path]


def begun(path: str | Path, output: str | Path, overwrite: bool) -> tuple[Any, Publish]:
    """The open stage of a cache, and what writes a layer of another form of it to the output, and
    returns its path. Raises InputError where one cannot be read or the other not be written."""
    target = check_output(output, overwrite)
    before = {target: standing(target)}
    stage = open_stage(path)
    refuse_inputs([target], [Path(path)])

    def written(layer: Any) -> Path:
        publish([(layer, target)], before)
        return target

    return stage, written


def composed(stage: Any) -> Any:
    """All that a stage composes, as one layer in memory."""
    return computed(stage.GetPseudoRoot(), stage.Flatten, False)


def plain_copy(layer: Any) -> Any:
    """A layer to change and to write."""
    # Export goes by the suffix of the layer's own name; a plain copy has the right one.
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    return copy


def flatten(path: str | Path, output: str | Path, overwrite: bool = False) -> Path:
    """Write a cache of any layout as one file without references, clips or sublayers.

    output: .usd, .usdc or .usda. The samples of the whole cache are in memory meanwhile. Raises
    InputError where one cannot be read or the other not be written.
    """
    stage, written = begun(path, output, overwrite)
    layer = plain_copy(composed(stage))
    if source := stage.GetRootLayer().customLayerData:
        layer.customLayerData = source
    return written(layer)
