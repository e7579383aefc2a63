"""Kinematics and energies of a pose, one energy a file."""
