"""Whole tasks from file to file: what the commands do, for programs that import featherfx."""
