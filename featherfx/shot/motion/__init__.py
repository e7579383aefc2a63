"""Motion of the roots of all feathers, at any time.

Change here: how roots move, another source of motion.
"""
