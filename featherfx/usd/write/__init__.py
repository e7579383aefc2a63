"""Writers of caches and of static feathers.

Change here: prims, primvars, materials.
"""
