"""Loads of a frame: gravity, wind, shelter, pins, forces.

Change here: a load of a shot.
"""
