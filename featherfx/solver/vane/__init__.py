"""Forces and stiffness of the vane in generalised coordinates.

Change here: how the vane's terms are assembled.
"""
