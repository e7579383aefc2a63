"""Every key that a user may write, declared once."""
