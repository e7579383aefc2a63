"""Caches in other forms: Alembic, condensed feathers, plain meshes."""
