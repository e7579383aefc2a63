"""A USD file and tables beside the scenes: skin, wind, collider, camera and curves."""

import numpy as np

HEAD = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Z"
    startTimeCode = 1
    endTimeCode = 3
    timeCodesPerSecond = 24
)
"""


def _tuples(values):
    return "[" + ", ".join(f"({', '.join(f'{x:.6g}' for x in row)})" for row in values) + "]"


def _grid(count, size, place):
    """Points and quads of a square patch."""
    steps = np.linspace(-size, size, count)
    points = np.array([[x, y, 0.3 * x * x] for y in steps for x in steps]) + place
    quads = [
        [j * count + i, j * count + i + 1, (j + 1) * count + i + 1, (j + 1) * count + i]
        for j in range(count - 1)
        for i in range(count - 1)
    ]
    return points, quads


def _mesh(name, place, size=0.1, count=5, more="", ways=((0, 0, 0), (0, 0, 0.004), (0, 0, 0.001))):
    points, quads = _grid(count, size, np.array(place))
    samples = ", ".join(
        f"{frame}: {_tuples(points + np.array(way))}" for frame, way in enumerate(ways, 1)
    )
    faces = ", ".join(str(k) for quad in quads for k in quad)
    st = _tuples((points[:, :2] - place[:2]) / (2 * size) + 0.5)
    along = (points[:, :1] - place[0]) / (2 * size) + 0.5
    colours = _tuples(np.hstack([along, 1.0 - along, 0.0 * along]))
    spot = ", ".join(["1"] + ["0"] * (len(points) - 1))
    mask = ", ".join(f"{x:.6g}" for x in (points[:, 0] - place[0]) / (2 * size) + 0.5)
    return f"""
def Mesh "{name}" (prepend apiSchemas = ["CollectionAPI:hit"])
{{
    point3f[] points = {_tuples(points)}
    point3f[] points.timeSamples = {{ {samples} }}
    int[] faceVertexCounts = [{", ".join("4" for _ in quads)}]
    int[] faceVertexIndices = [{faces}]
    uniform token subdivisionScheme = "none"
    texCoord2f[] primvars:st = {st} ( interpolation = "vertex" )
    float[] primvars:mask = [{mask}] ( interpolation = "vertex" )
    float[] primvars:spot = [{spot}] ( interpolation = "vertex" )
    vector3f[] primvars:flow = {_tuples([[0.3, 1, 0]] * len(points))} ( interpolation = "vertex" )
    color3f[] primvars:displayColor = {colours} ( interpolation = "vertex" )
    rel collection:hit:includes = [</{name}>]
    {more}
}}
"""


SUBSET = """
    def GeomSubset "half"
    {
        uniform token elementType = "face"
        int[] indices = [0, 1, 2, 3, 4, 5, 6, 7]
        uniform token familyName = "part"
    }
"""
REST = """
def Points "air"
{
    point3f[] points = CORNERS
    vector3f[] velocities = SLOW
    vector3f[] velocities.timeSamples = { 1: SLOW, 3: FAST }
    custom vector3f gale = (0, 8, 0)
}

def Camera "camera"
{
    float focalLength = 35
    float horizontalAperture = 36
    float verticalAperture = 24
    float2 clippingRange = (0.01, 100)
    double3 xformOp:translate = (0, 0, 2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}

def Camera "far" { float focalLength = 35
    double3 xformOp:translate = (0, 0, 40)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}

def BasisCurves "edge"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [3]
    point3f[] points = [(0, -0.05, 0), (0.03, 0, 0), (0, 0.05, 0)]
}

def BasisCurves "other_edge"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [3]
    point3f[] points = [(0, -0.06, 0), (0.03, 0.01, 0), (0, 0.05, 0)]
}

def BasisCurves "drawn"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [4]
    point3f[] points = LINE
    point3f[] points.timeSamples = { 1: LINE, 3: BENT }
    uniform string[] primvars:featherKind = ["covert"] ( interpolation = "uniform" )
    uniform string[] primvars:sort = ["contour"] ( interpolation = "uniform" )
    uniform string[] primvars:label = ["named"] ( interpolation = "uniform" )
    uniform vector3f[] primvars:up = [(0, 0, 1)] ( interpolation = "uniform" )
    uniform vector3f[] primvars:above = [(0, 1, 1)] ( interpolation = "uniform" )
    uniform float[] primvars:larger = [1.3] ( interpolation = "uniform" )
}

def BasisCurves "more"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    point3f[] points = [(0, 0.1, 0), (0.1, 0.1, 0.01)]
    uniform string[] primvars:featherKind = ["covert"] ( interpolation = "uniform" )
    uniform vector3f[] primvars:up = [(0, 0, 1)] ( interpolation = "uniform" )
}
"""
NUMBERS = {
    "CORNERS": _tuples([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]),
    "SLOW": _tuples([[0, 3, 4]] * 8),
    "FAST": _tuples([[0, 9, 4]] * 8),
    "LINE": _tuples([[0, 0, 0], [0.05, 0, 0.003], [0.1, 0.01, 0.002], [0.14, 0.02, -0.004]]),
    "BENT": _tuples([[0, 0, 0], [0.05, 0, 0.003], [0.1, 0.01, 0.002], [0.16, 0.04, -0.004]]),
}
TABLE = """id,kind,x,y,z,direction_x,direction_y,direction_z,up_x,up_y,up_z
one,covert,0,0,0,1,0,0,0,0,1
"""
OTHER_TABLE = TABLE.replace("one,covert,0,0,0,1", "one,covert,0.01,0,0,1")
NO_KIND = TABLE.replace("kind,", "").replace("covert,", "")


def write_assets(folder):
    """Write them into a folder."""
    text = HEAD + _mesh("skin", (0, 0, 0), more=SUBSET)
    text += _mesh("patch", (0, 0, 0.05), more=SUBSET)
    # from below into the feather, a different way in each frame
    rising = ((0, 0, 0), (0, 0, 0.02), (0, 0, 0.05))
    text += _mesh("plate", (0.06, 0, -0.02), size=0.05, count=3, ways=rising)
    text += _mesh("other_plate", (0.06, 0, -0.015), size=0.05, count=3, ways=rising)
    text += REST
    for name, numbers in NUMBERS.items():
        text = text.replace(name, numbers)
    (folder / "scene.usda").write_text(text)
    (folder / "table.csv").write_text(TABLE)
    (folder / "other.csv").write_text(OTHER_TABLE)
    (folder / "no_kind.csv").write_text(NO_KIND)
