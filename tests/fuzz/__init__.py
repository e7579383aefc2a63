"""Damaged inputs, and what the program makes of them; not part of the test suite."""

import sys
from pathlib import Path

# the helpers of all tests, and of those of USD
sys.path += [str(Path(__file__).resolve().parents[1] / name) for name in ("", "usd", "usdin")]
