"""Ribbons: strips that bend as developable surfaces."""
