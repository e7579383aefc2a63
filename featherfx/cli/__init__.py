"""The commands; each imports what it needs when it runs.

Change here: a command, an option, a progress line.
"""
