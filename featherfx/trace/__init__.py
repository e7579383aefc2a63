"""Feather presets from pictures of feathers."""
