"""The version of the program, for every room to read."""

__version__ = "0.1.0"
