"""Plumage as it is shown: each feather laid over those beneath it, frame by frame."""
