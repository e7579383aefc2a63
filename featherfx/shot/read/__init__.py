"""Shot files in, with every problem found at once."""
