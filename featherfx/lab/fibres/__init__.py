"""Membranes of fibres that yield and break."""
