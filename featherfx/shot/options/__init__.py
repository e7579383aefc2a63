"""Options of every feather of a shot, resolved before the first frame."""
