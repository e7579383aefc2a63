"""Levels of detail, and motion that need not be computed."""
