"""Hooks that slip, open and heal, and feathers that are wet.

Change here: what opens or closes a vane during a shot.
"""
