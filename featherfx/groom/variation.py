"""Seeded variation: each feather draws by the seed and its own id, so others never matter."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

LIMIT = 3.0  # standard deviations; keeps lengths positive


def draws(seed: int, ids: Iterable[str]) -> NDArray[np.float64]:
    """(n, 4) normal draws (length, width, camber, roll), clipped at LIMIT."""
    digests = b"".join(
        hashlib.blake2b(f"{seed}:{name}".encode(), digest_size=64).digest() for name in ids
    )
    words = np.frombuffer(digests, dtype="<u8").reshape(-1, 8) >> np.uint64(11)
    uniform = (words.astype(np.float64) + 0.5) / 2.0**53
    radius = np.sqrt(-2.0 * np.log(uniform[:, :4]))
    return np.clip(radius * np.cos(2.0 * np.pi * uniform[:, 4:]), -LIMIT, LIMIT)


def variant_number(name: str, variants: int) -> int:
    """Which of the variants a feather is, by its id."""
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") % variants
