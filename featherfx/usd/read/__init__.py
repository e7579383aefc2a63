"""Readers of caches, and of scenes of other programs.

Change here: what is read of a scene.
"""
