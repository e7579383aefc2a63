"""Hooks that slip, open and heal, and feathers that are wet."""
