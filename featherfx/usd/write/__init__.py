"""Writers of caches and static feathers to USD, complete or not at all."""
