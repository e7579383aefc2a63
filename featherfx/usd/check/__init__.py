"""What is wrong with a USD file that its own validators let pass."""
