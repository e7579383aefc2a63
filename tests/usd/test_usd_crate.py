"""Crate files that are written value by value, as USD reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Vt

from featherfx.usd.types import StageSpace
from featherfx.usd.write.crate import CrateFile, CrateLayer
from featherfx.usd.write.layers import StageInfo, new_layer

CODES = [1.0, 1.5, 2.0]
KINDS = {
    "points": (Sdf.ValueTypeNames.Point3fArray, Vt.Vec3fArray, (3,), np.float32),
    "velocitiesHalf": (Sdf.ValueTypeNames.Vector3hArray, Vt.Vec3hArray, (3,), np.float16),
    "primvars:orient": (Sdf.ValueTypeNames.QuathArray, Vt.QuathArray, (4,), np.float16),
    "primvars:strain": (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray, (), np.float32),
    "numbers": (Sdf.ValueTypeNames.IntArray, Vt.IntArray, (), np.int32),
}


def layer_of(prims: list[str]) -> tuple[Any, list[tuple[Any, str]]]:
    layer = new_layer(StageInfo("bird", StageSpace(0.1, "Y"), (1.0, 2.0), 23.976))
    paths = []
    for prim in prims:
        for name, (kind, *_) in KINDS.items():
            paths.append((Sdf.Path(f"{prim}.{name}"), name))
            Sdf.JustCreatePrimAttributeInLayer(layer, paths[-1][0], kind)
    layer.GetAttributeAtPath(f"{prims[0]}.points").SetInfo("interpolation", "vertex")
    layer.GetAttributeAtPath(f"{prims[-1]}.points").SetInfo("elementSize", 7)
    return layer, paths


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_usd_reads_the_layer_with_its_samples(tmp_path: Path, count: int):
    # prims with children, siblings, both and neither
    prims = ["/bird/feathers", "/bird/feathers/a/b", "/bird/feathers/c", "/bird/rachises", "/z"]
    prims += [f"/bird/many/{'long_name_' * 9}{k}" for k in range(40)]
    layer, paths = layer_of(prims)
    expected = Sdf.Layer.CreateAnonymous(".usda")
    expected.TransferContent(layer)
    random = np.random.default_rng(1)
    samples = []
    with (tmp_path / "a.usdc").open("wb") as file:
        crate = CrateFile(file, CrateLayer(layer, [path for path, _ in paths]))
        for path, name in paths:
            _, kind, shape, number = KINDS[name]
            values = [(9.0 * random.random((count, *shape))).astype(number) for _ in CODES[1:]]
            stands = [crate.add(each) for each in values]
            samples.append([*stands, stands[0]])  # the first once more
            for code, each in zip(CODES, [*values, values[0]], strict=True):
                expected.SetTimeSample(path, code, kind.FromNumpy(each))
        crate.finish(CODES, samples)
    found = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "a.usdc"))
    assert found.ExportToString() == expected.ExportToString()
