"""What acts on feathers during a frame: gravity, wind, grips, forces."""
