"""Feathers of a shot that touch each other and moving meshes.

Change here: how a shot's contact is stepped.
"""
