"""What is read from USD: caches, and the scenes of others."""
