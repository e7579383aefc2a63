"""Maps of many shapes at once: those of each, kept and read again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from featherfx.feather.build import build_feather
from featherfx.feather.density import density_map
from featherfx.feather.shapes import build_unit_maps
from featherfx.groom.keys.problems import Problems
from featherfx.groom.presets.library import Library
from featherfx.groom.read.read import groom_of

COARSE, FINE = (6, 3), (11, 6)


@pytest.fixture
def shapes(monkeypatch, tmp_path):
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path))
    library = Library((), Problems())
    feather = {"id": "a", "kind": "swan_primary", "position": [0, 0, 0]}
    groom = groom_of({"name": "one", "feather": [feather]}, Path("one.toml"), library)
    kind = groom.feathers[0].kind
    return (kind, False), (replace(kind, length=0.5 * kind.length), True)


def test_maps_are_those_of_each_shape_and_the_same_when_they_are_read_again(shapes, monkeypatch):
    first = build_unit_maps(shapes, COARSE, FINE)
    # what is kept needs no feather
    monkeypatch.setattr("featherfx.feather.build.build_feather", None)
    for found in (first, build_unit_maps(shapes, COARSE, FINE)):
        for (kind, mirrored), own in zip(shapes, found, strict=True):
            coarse, fine = (build_feather(kind, *grid, mirrored) for grid in (COARSE, FINE))
            expected = density_map(coarse, fine)
            for a, b in zip(own(coarse.rest), expected(coarse.rest), strict=True):
                assert a.shape == b.shape
                assert np.array_equal(a, b)
            assert np.array_equal(own.pieces, expected.pieces)
    assert build_unit_maps((), COARSE, FINE) == []
