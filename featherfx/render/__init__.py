"""Pictures of caches without a screen."""
