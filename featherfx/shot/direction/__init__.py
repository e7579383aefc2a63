"""Art direction: channels, targets and orders of a shot.

Change here: a channel, a target.
"""
