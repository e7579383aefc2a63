"""The mesh that feathers grow on."""
