"""How finely each feather is computed, and what need not be computed at all."""
