"""Caches and static feathers written to USD, complete or not at all."""
