"""Rods and ribbons, which bend as lines and as developable strips, beside other solutions."""
