"""Descriptions of feathers by an artist: their kinds, their places and their looks."""
