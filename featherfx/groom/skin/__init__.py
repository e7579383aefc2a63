"""The mesh that feathers grow on.

Change here: what is asked of a skin.
"""
