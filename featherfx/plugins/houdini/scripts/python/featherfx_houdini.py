"""featherfx in Houdini: nodes that groom curves, bake them and load what was written, and a shelf.

A featherfx node is Houdini's own Python SOP or Python Script LOP with parameters of ours; all that
it does when it cooks is `cook_sop` or `cook_lop`. Its buttons run the command beside Houdini.
"""

import os

import featherfx_geometry
import featherfx_host
import hou

CODE = "import featherfx_houdini\nfeatherfx_houdini.cook_{}()\n"
BUTTON = "import featherfx_houdini; featherfx_houdini.{}(kwargs['node'])"
NOTHING_YET = "{} is not there yet: press Groom or Bake"


def make_sop(kwargs):
    """A node for curves of geometry, placed as the tab menu places any other."""
    import soptoolutils

    return dressed(soptoolutils.genericTool(kwargs, "python"), "sop")


def make_lop(kwargs):
    """A node for curves of a stage, placed as the tab menu places any other."""
    import loptoolutils

    return dressed(loptoolutils.genericTool(kwargs, "pythonscript"), "lop")


def dressed(node, kind):
    """A Python node with what makes it ours."""
    group = node.parmTemplateGroup()
    group.append(hou.FolderParmTemplate("featherfx", "featherfx", _parameters(kind)))
    node.setParmTemplateGroup(group)
    node.parm("python").set(CODE.format(kind))
    node.setName("featherfx", unique_name=True)
    return node


def _parameters(kind):
    def text(name, label, value="", **more):
        return hou.StringParmTemplate(name, label, 1, default_value=(value,), **more)

    def file(name, label, value=""):
        return text(name, label, value, string_type=hou.stringParmType.FileReference)

    def button(name, label, function):
        language = hou.scriptLanguage.Python
        call = BUTTON.format(function)
        return hou.ButtonParmTemplate(
            name, label, script_callback=call, script_callback_language=language
        )

    own = {
        "lop": [text("skin", "Skin (mesh of this stage)")],
        "sop": [hou.FloatParmTemplate("frame", "Frame", 1, default_expression=("$FF",))],
    }
    return [
        file("cache", "Cache to write", "$HIP/feathers/$OS.usdc"),
        text("kind", "Kind, without featherKind", "contour"),
        text("quality", "Quality", "draft", menu_items=("draft", "preview", "final")),
        hou.IntParmTemplate("frames", "Frames", 2, default_expression=("$FSTART", "$FEND")),
        hou.FloatParmTemplate(
            "wind", "Wind, m/s", 3, naming_scheme=hou.parmNamingScheme.XYZW, default_value=(0, 0, 0)
        ),
        hou.FloatParmTemplate("gust", "Gusts, share of it", 1, default_value=(0.3,)),
        file("shot", "Shot instead of the above"),
        *own[kind],
        button("groom", "Groom", "groom"),
        button("bake", "Bake", "bake"),
        text("show", "Show", "groom", menu_items=("groom", "cache")),
    ]


def cook_lop():
    """The stage of the input, with the feathers as a layer beneath."""
    node = hou.pwd()
    file = _shown(node)
    node.editableStage()
    if os.path.isfile(file):
        node.addSubLayer(file)
    else:
        raise hou.NodeWarning(NOTHING_YET.format(file))


def cook_sop():
    """The meshes of the feathers at the node's frame; the curves while there are none."""
    node = hou.pwd()
    file = _shown(node)
    if not os.path.isfile(file):
        raise hou.NodeWarning(NOTHING_YET.format(file))
    key = file, os.stat(file).st_mtime_ns
    kept = node.cachedUserData("featherfx")
    if kept is None or kept[0] != key:  # topology is made once for each file
        meshes = featherfx_geometry.Meshes(file)
        made = hou.Geometry()
        meshes.build(made)
        kept = key, meshes, made
        node.setCachedUserData("featherfx", kept)
    geometry = node.geometry()
    geometry.clear()
    geometry.merge(kept[2])
    kept[1].pose(geometry, node.evalParm("frame"))


def groom(node):
    """Button: the feathers of the curves at rest."""
    _press(node, "groom")


def bake(node):
    """Button: the feathers of the curves, or of the shot that is named, in motion."""
    _press(node, "cache")


def _press(node, what, *more):
    try:
        run, output = _started(node, what, *more)
        _follow(run, "grooming" if what == "groom" else "baking")
    except (featherfx_host.HostError, OSError) as error:
        if "--overwrite" not in str(error) or more:
            _tell(error)
        elif not hou.ui.displayMessage(
            str(error), buttons=("Bake anew", "Cancel"), default_choice=1, close_choice=1
        ):
            _press(node, what, "--overwrite")
        return
    node.parm("show").set(what)
    hou.lop.reloadLayer(output, True)
    node.cook(force=True)


def _started(node, what, *more):
    """A run of what a button asks for, and the file that it writes."""
    cache = node.evalParm("cache")
    os.makedirs(os.path.dirname(cache) or ".", exist_ok=True)
    shot = node.evalParm("shot") if what == "cache" else ""
    space = "Y", 1.0
    if not shot:
        curves = _beside(cache, ".curves.usdc")
        space = _write_curves(node, curves)
    options = "--up-axis", space[0], "--meters-per-unit", space[1], *more
    if what == "cache":
        shot = shot or _write_shot(node, cache, curves, space[0])
        return featherfx_host.bake(shot, cache, *options), cache
    groom_file, output = _beside(cache, ".groom.toml"), _beside(cache, ".rest.usdc")
    featherfx_host.write_groom(groom_file, curves, node.evalParm("kind"))
    options += "--no-instances", "--quality", node.evalParm("quality")
    return featherfx_host.groom(groom_file, output, *options), output


def _write_curves(node, file):
    """The curves of a node's input as a file; its up axis, and metres in its unit."""
    inputs = [each for each in node.inputs() if each is not None]
    if not inputs:
        raise featherfx_host.HostError("connect what has the curves, or name a shot")
    if isinstance(node, hou.SopNode):
        geometry = inputs[0].geometry()
        if not featherfx_geometry.write_curves(geometry, file):
            raise featherfx_host.HostError("the input has no open polylines")
        return "Y", 1.0
    stage = inputs[0].stage()
    stage.Flatten().Export(file)
    return featherfx_geometry.space_of(stage)


def _write_shot(node, cache, curves, up_axis):
    groom_file, shot = _beside(cache, ".groom.toml"), _beside(cache, ".shot.toml")
    featherfx_host.write_groom(groom_file, curves, node.evalParm("kind"))
    skin = node.parm("skin")
    featherfx_host.write_shot(
        shot,
        groom_file,
        frames=node.parmTuple("frames").eval(),
        frames_per_second=hou.fps(),
        quality=node.evalParm("quality"),
        wind=featherfx_host.with_z_up(node.parmTuple("wind").eval(), up_axis),
        gust=node.evalParm("gust"),
        skin=(curves, skin.eval()) if skin is not None and skin.eval() else None,
    )
    return shot


def _shown(node):
    cache = node.evalParm("cache")
    return cache if node.evalParm("show") == "cache" else _beside(cache, ".rest.usdc")


def _beside(cache, ending):
    return os.path.splitext(cache)[0] + ending


def bake_shot():
    """Shelf: ask for a shot and a cache, bake, and load the cache in /stage."""
    shot = hou.ui.selectFile(title="featherfx shot", pattern="*.toml")
    if not shot:
        return None
    suggested = os.path.splitext(hou.text.expandString(shot))[0] + ".usdc"
    output = hou.ui.selectFile(title="Cache to write", pattern="*.usdc", start_directory=suggested)
    if not output:
        return None
    shot, output = hou.text.expandString(shot), hou.text.expandString(output)
    try:
        _follow(featherfx_host.bake(shot, output), "baking")
    except featherfx_host.HostError as error:
        _tell(error)
        return None
    node = hou.node("/stage").createNode("sublayer", "featherfx_cache")
    node.parm("filepath1").set(output)
    node.setDisplayFlag(True)
    return output


def _follow(run, title):
    """Follow a run to its end with Houdini's own progress. Raises HostError."""
    with hou.InterruptableOperation(f"featherfx: {title}", open_interrupt_dialog=True) as bar:
        for told in run:
            try:
                bar.updateProgress(featherfx_host.share_done(told))
            except hou.OperationInterrupted:
                run.cancel()
    run.finish()


def _tell(error):
    hou.ui.displayMessage(str(error), severity=hou.severityType.Error)
