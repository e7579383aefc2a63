"""Caches in other forms: Alembic, glTF, levels of detail, transforms, another time.

Change here: `featherfx export`, `featherfx retime`.
"""
