"""Faults of USD files that USD's own validators let pass.

Change here: `featherfx check` of caches.
"""
