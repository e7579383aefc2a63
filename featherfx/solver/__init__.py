"""One step of one feather, and what feathers that touch share."""
