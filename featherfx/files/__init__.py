"""Files that are complete or not there, caches on disk, locks.

Change here: how something is written, locked or cached.
"""
