"""Kinematics and energies of a pose, one energy a file.

Change here: a material, an energy, the law of a load.
"""
