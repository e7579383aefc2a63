"""Grooms that know birds: wings, tails, crests and whole plumages from a few landmarks."""
