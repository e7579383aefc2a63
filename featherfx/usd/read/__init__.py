"""Readers of caches, grooms and scenes in USD."""
