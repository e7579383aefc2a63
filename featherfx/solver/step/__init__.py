"""One feather through one frame: implicit steps, entirely compiled.

Change here: a step, its size, its fallbacks.
"""
