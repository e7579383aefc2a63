"""A page that plays a cache in a browser: from a local server, or as one file."""
