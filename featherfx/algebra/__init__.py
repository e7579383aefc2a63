"""Rotations and vectors, for arrays and for kernels."""
