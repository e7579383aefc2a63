"""How every feather of a shot is simulated, resolved before the first frame."""
