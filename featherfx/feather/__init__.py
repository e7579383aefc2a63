"""The rest shape of one feather: rachis, outlines, barbs, the barb grid and its surface.

Change here: the shape of a feather at rest, how barbs are drawn.
"""
