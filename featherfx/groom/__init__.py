"""Groom descriptions: which feathers, where, and of which kind.

Change here: what an artist can describe.
"""
