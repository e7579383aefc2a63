"""What the tests of pages share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from places import ROOT


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    """Feathers that flap, by hand: no solver is needed."""
    import sys

    sys.path.insert(0, str(ROOT / "tests/usd"))
    import feathers

    from featherfx.usd.write.cache_writer import CacheWriter

    folder = tmp_path_factory.mktemp("view")
    for name, last in (("flaps", 5), ("others", 7)):
        with CacheWriter(folder / f"{name}.usdc", feathers.entries(), (1, 5), 24.0) as writer:
            for number in range(1, 6):
                frame = feathers.frame(number if number < 5 else last)
                writer.write(replace(frame, number=float(number)))
    return folder / "flaps.usdc"
