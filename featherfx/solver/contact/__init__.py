"""One interval of time for feathers that touch."""
