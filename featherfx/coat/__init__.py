"""Coat space: which feather of a plumage lies over which, and how far above the skin.

A field over the skin answers both. The stacking coordinate phi (m) grows along the flow of the
feathers; a feather has the value p at its follicle. Its leaf is the surface at the height

    h(x; p) = T(x) (d + s) + a(x) w(s),      s = (phi(x) - p) / q(x)

over the carrier, a smoothed skin. T (m) is the thickness of the coat, q (m) the gain of phi over a
feather's length, d a layer of down, a (m) a lift; w grows with s. At one place a feather that
starts upstream lies higher, so leaves of different p never meet. Feathers are drawn on their leaves
in their own plane form, rachis and barbs exactly as long as in it.

Interface
    carrier.make_mesh(points, triangles) -> CoatMesh     topology and factors of a skin
    carrier.pose_carrier(mesh, points) -> Carrier             the smoothed skin in any pose
    forms.make_plane_forms(nodes, directors, ...) -> PlaneForms
    coat.grow_coat(mesh, follicles) -> Coat                   fields and follicles, constant
    coat.stack(coat, footprints) -> Coat                      the same with overlapping leaves apart
    coat.draw(coat, carrier, forms, numbers) -> LeafArrays
A moving skin carries all of it: pose the carrier and draw again. Related: Bangay 2007 (coats along
field lines), Liu et al. 2015 (height field in growth order).

Change here: order, spacing and rest shapes of plumage.
"""
