"""Plumage that grows in regions of a skin."""
