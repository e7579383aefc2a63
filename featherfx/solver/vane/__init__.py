"""Forces and stiffness of the vane in generalised coordinates."""
