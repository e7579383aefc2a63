"""One cache to draw, with the hand-made feathers of the USD tests."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "usd"))


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    import feathers

    from featherfx.usd.write.cache_writer import CacheWriter

    path = tmp_path_factory.mktemp("render") / "four.usdc"
    with CacheWriter(path, feathers.entries(), (1, 5), 24.0) as writer:
        for number in range(1, 6):
            writer.write(feathers.frame(number))
    return path
