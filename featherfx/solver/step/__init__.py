"""One feather through one frame: implicit steps, entirely compiled."""
