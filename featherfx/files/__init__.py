"""Files that are complete or not there, and work beside them."""
