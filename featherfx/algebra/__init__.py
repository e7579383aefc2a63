"""Vectors, rotations, sparse matrices and images of numbers, for arrays and for kernels.

Change here: a formula that no package owns.
"""
