"""Wings, tails, crests and whole birds from a few landmarks.

Change here: a species, how a wing folds.
"""
