"""Images of caches without a screen.

Change here: `featherfx preview`.
"""
