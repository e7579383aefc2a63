"""Plumage that grows in regions of a skin.

Change here: density, direction and blending of regions.
"""
