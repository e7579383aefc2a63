"""Plumage at rest: feathers over each other like shingles.

Change here: `[layout]` of a groom.
"""
