"""The choices that a picture offers; importable without any library for pictures."""

COLOURS = ("shaded", "barb", "region", "strain")
VIEWS = ("auto", "top", "side", "front")
