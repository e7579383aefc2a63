"""Feathers brought to rest, and poses taken up from outside."""
