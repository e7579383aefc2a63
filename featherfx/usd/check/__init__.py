"""Checks and measurements of USD files."""
