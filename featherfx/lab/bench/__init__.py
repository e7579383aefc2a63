"""Run time against error, and stability under absurd input.

Change here: a table of `featherfx bench`.
"""
