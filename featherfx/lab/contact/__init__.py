"""Flat plates that touch, whose load and motion have closed forms."""
