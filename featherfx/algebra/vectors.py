"""Rows of vectors."""

from __future__ import annotations

from typing import Any

import numpy as np


def unit(vectors: Any) -> Any:
    """Vectors (..., k) over their lengths; those without length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)
