"""Pages in a browser that play caches, simulate shots and tune presets.

Change here: `featherfx view`, `featherfx tune`.
"""
