"""The rest shape of one feather."""
