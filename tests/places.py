"""Where the checkout and its samples are, and the quality of quick shots."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "samples"
# presets of qualities have an error to keep, which bakes measure first
COARSE = (
    "quality = { rows = 11, columns = 4, coefficients = 1, tolerance = 1e-3,"
    " spectral_radius = 0.5 }\n"
)
