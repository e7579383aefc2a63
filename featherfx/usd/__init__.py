"""USD stages in and out; the only room that imports `pxr`."""
