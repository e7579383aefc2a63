"""Motion of the roots of all feathers."""
