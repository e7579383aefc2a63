"""Feathers of a shot that touch each other and moving meshes."""
