"""Feather presets from photographs: silhouette, rachis, barbs.

Change here: `featherfx trace`.
"""
