"""Plumage at rest: feathers over each other like shingles."""
