"""Alembic files, read back with the binding that wrote them, against the cache."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import featherfx.baking.pipeline as pipeline
from featherfx.errors import InputError
from featherfx.usd.read.cache import Cache


def points_of(schema, index: int) -> np.ndarray:
    from alembic3d.Abc import ISampleSelector

    time = schema.getTimeSampling().getSampleTime(index)
    found = schema.getValue(ISampleSelector(time)).getPositions()
    return np.array([tuple(point) for point in found])


@pytest.mark.parametrize("frames", [None, (2, 4)])
def test_every_sample_is_there(caches, tmp_path, frames):
    abc = pytest.importorskip("alembic3d.Abc")
    geometry = pytest.importorskip("alembic3d.AbcGeom")
    out = tmp_path / "wing.abc"
    assert pipeline.export(caches["clips"], out, frames=frames) == [out]
    assert [file.name for file in tmp_path.iterdir()] == ["wing.abc"]
    cache, top = Cache(caches["clips"]), abc.IArchive(str(out)).getTop()
    first, last = frames or (1, 5)
    assert len(cache.feathers) == 4
    assert top.getNumChildren() == 8  # a mesh and a shaft of each
    for index, feather in enumerate(cache.feathers):
        mesh = geometry.IPolyMesh(top, feather.path.rpartition("/")[2])
        schema = mesh.getSchema()
        assert schema.getNumSamples() == last - first + 1
        properties = schema.getUserProperties()
        assert abc.IStringProperty(properties, "featherId").getValue() == feather.id
        for k, code in enumerate(range(first, last + 1)):
            assert schema.getTimeSampling().getSampleTime(k) == pytest.approx(code / 24.0)
            np.testing.assert_array_equal(points_of(schema, k), cache.pose(index, code).points)
        sample = schema.getValue(abc.ISampleSelector(first / 24.0))
        corners = np.array(list(sample.getFaceIndices())).reshape(-1, 3)
        np.testing.assert_array_equal(corners[:, ::-1], feather.triangles)
        expected = cache.pose(index, first).velocities
        assert (sample.getVelocities() is None) == (expected is None)
        if expected is not None:
            velocities = np.array([tuple(each) for each in sample.getVelocities()])
            np.testing.assert_array_equal(velocities, expected.astype(np.float32))
        st = np.array([tuple(each) for each in schema.getUVsParam().getExpandedValue().getVals()])
        np.testing.assert_array_equal(st, feather.st)
        normals = schema.getNormalsParam().getExpandedValue().getVals()
        found = np.array([tuple(each) for each in normals])
        np.testing.assert_array_equal(found, cache.pose(index, first).normals.astype(np.float32))
        for name, faces in feather.subsets.items():
            subset = schema.getFaceSet(name).getSchema().getValue().getFaces()
            np.testing.assert_array_equal(np.array(list(subset)), faces)


def test_what_cannot_be_written_is_told(caches, tmp_path):
    pytest.importorskip("alembic3d")
    out = tmp_path / "wing.abc"
    with pytest.raises(InputError, match=r"4-9 is out of range\. Give 1 to 5"):
        pipeline.export(caches["usdc"], out, frames=(4, 9))
    out.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        pipeline.export(caches["usdc"], out)
    assert out.read_text() == "mine"
    with pytest.raises(InputError, match="folder"):
        pipeline.export(caches["usdc"], tmp_path / "none" / "wing.abc")


def test_without_the_library_the_extra_is_named(caches, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "alembic3d", None)
    with pytest.raises(InputError, match=r"featherfx\[alembic\]"):
        pipeline.export(caches["usdc"], tmp_path / "wing.abc")
    assert list(tmp_path.iterdir()) == []
