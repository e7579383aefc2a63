"""Makes the hand-made feathers importable and writes each kind of cache once."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def caches(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Five frames of the four feathers, in each layout and encoding."""
    import feathers

    from featherfx.usd.write.cache_writer import CacheWriter
    from featherfx.usd.write.options import WriteOptions

    folder = tmp_path_factory.mktemp("caches")
    made = {
        "usda": "flat", "usdc": "flat", "usd": "flat", "payload": "payload", "clips": "clips",
    }  # fmt: skip
    paths = {}
    for name, layout in made.items():
        suffix = "usda" if name in ("payload", "clips") else name
        paths[name] = folder / f"{name}.{suffix}"
        with CacheWriter(
            paths[name],
            feathers.entries(),
            (1, 5),
            24.0,
            WriteOptions(layout=layout, chunk=2),
            metadata={"shot": "s"},
        ) as writer:
            for number in range(1, 6):
                writer.write(feathers.frame(number))
    return paths
