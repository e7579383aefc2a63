"""Caches in other forms: Alembic, glTF, condensed feathers, transforms.

Change here: `featherfx export`, `featherfx retime`, `featherfx sculpt`.
"""
