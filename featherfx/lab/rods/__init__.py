"""Rods: the shaft alone, beside solutions by other means."""
