"""Loads on feathers during a frame: gravity, wind, grips, forces."""
