"""Presets found, merged and turned into kinds of feathers."""
