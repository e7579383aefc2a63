"""One implicit step of one feather, and contact between feathers.

Change here: time integration, Newton, error control.
"""
