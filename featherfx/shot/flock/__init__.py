"""Flocks: many birds of a few shots, each on its path."""
