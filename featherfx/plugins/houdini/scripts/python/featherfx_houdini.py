"""featherfx in Houdini: bake a shot and load it in Solaris; feathers of the curves of a LOP."""

import os
import tempfile

import featherfx_host
import hou


def bake_shot():
    """Ask for a shot and a cache, bake, and load the cache in /stage."""
    shot = hou.ui.selectFile(title="featherfx shot", pattern="*.toml")
    if not shot:
        return None
    suggested = os.path.splitext(hou.text.expandString(shot))[0] + ".usdc"
    output = hou.ui.selectFile(title="Cache to write", pattern="*.usdc", start_directory=suggested)
    if not output:
        return None
    shot, output = hou.text.expandString(shot), hou.text.expandString(output)
    return output if _followed(featherfx_host.bake(shot, output), "baking", output) else None


def groom_curves():
    """Feathers of the curves of the selected LOP at rest, as condensed feathers or shafts with
    featherKind say, loaded behind it."""
    nodes = [each for each in hou.selectedNodes() if isinstance(each, hou.LopNode)]
    if len(nodes) != 1:
        hou.ui.displayMessage("Select one LOP whose stage has the curves.")
        return None
    folder = tempfile.mkdtemp(prefix="featherfx_")
    curves, output = os.path.join(folder, "curves.usdc"), os.path.join(folder, "feathers.usdc")
    nodes[0].stage().Flatten().Export(curves)
    return output if _followed(featherfx_host.groom(curves, output), "grooming", output) else None


def _followed(run, title, output):
    """Follow a run with Houdini's own progress; load what it wrote. Whether it came to its end."""
    try:
        with hou.InterruptableOperation(f"featherfx: {title}", open_interrupt_dialog=True) as bar:
            for told in run:
                try:
                    bar.updateProgress(featherfx_host.share_done(told))
                except hou.OperationInterrupted:
                    run.cancel()
        run.finish()
    except featherfx_host.HostError as error:
        hou.ui.displayMessage(str(error), severity=hou.severityType.Error)
        return False
    load(output)
    return True


def load(cache):
    """A sublayer LOP of a cache, displayed."""
    node = hou.node("/stage").createNode("sublayer", "featherfx_cache")
    node.parm("filepath1").set(cache)
    node.setDisplayFlag(True)
    return node
