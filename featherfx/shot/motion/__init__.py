"""Where the roots of all feathers are at any time."""
