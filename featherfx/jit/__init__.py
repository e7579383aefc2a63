"""Compiled kernels: inlining, linking, and a cache of machine code keyed by content.

Change here: how kernels are compiled, stored and loaded.
"""
