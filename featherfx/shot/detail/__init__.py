"""Level of detail of each feather, and work that can be skipped.

Change here: a level of detail, a way to skip work.
"""
