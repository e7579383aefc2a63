"""The commands of the virtual lab."""
