"""Rods: the rachis alone, beside solutions by other means."""
