"""Presets: search, merging, and kinds of feathers made from them.

Change here: how presets are found and combined.
"""
