"""featherfx in Maya: a menu and a shelf button that bake a shot and load the cache as a stage."""

import os

import featherfx_host
from maya import cmds

MENU = "featherfxMenu"


def make_menu():
    """The menu beside Maya's own."""
    if cmds.menu(MENU, exists=True):
        cmds.deleteUI(MENU)
    cmds.menu(MENU, label="featherfx", parent="MayaWindow", tearOff=True)
    cmds.menuItem(label="Bake shot...", parent=MENU, command=lambda *_: bake_shot())
    cmds.menuItem(label="Load cache...", parent=MENU, command=lambda *_: load_chosen())
    cmds.menuItem(label="Add to shelf", parent=MENU, command=lambda *_: add_to_shelf())


def add_to_shelf():
    """A button on the shelf that is open."""
    shelf = cmds.tabLayout("ShelfLayout", query=True, selectTab=True)
    return cmds.shelfButton(
        parent=shelf,
        label="featherfx",
        annotation="Bake a featherfx shot",
        image1="commandButton.png",
        imageOverlayLabel="fthr",
        sourceType="python",
        command="import featherfx_maya; featherfx_maya.bake_shot()",
    )


def bake_shot():
    """Ask for a shot and a cache, bake, and load the cache."""
    shot = _asked("featherfx shot (*.toml)", 1)
    output = _asked("USD cache (*.usdc *.usda *.usd)", 0) if shot else None
    if not output:
        return None
    options = ("--meters-per-unit", "0.01", "--up-axis", cmds.upAxis(query=True, axis=True).upper())
    run = featherfx_host.bake(shot, output, *options)
    cmds.progressWindow(title="featherfx", status="starting", isInterruptable=True, maxValue=100)
    try:
        for told in run:
            share = round(100 * featherfx_host.share_done(told))
            cmds.progressWindow(edit=True, progress=share, status=told["phase"])
            if cmds.progressWindow(query=True, isCancelled=True):
                run.cancel()
        run.finish()
    except featherfx_host.HostError as error:
        cmds.confirmDialog(title="featherfx", message=str(error), icon="critical")
        return None
    finally:
        cmds.progressWindow(endProgress=True)
    return load(output)


def load_chosen():
    """Ask for a cache and load it."""
    cache = _asked("USD cache (*.usdc *.usda *.usd)", 1)
    return load(cache) if cache else None


def load(cache):
    """A cache as a stage that plays with Maya's time."""
    cmds.loadPlugin("mayaUsdPlugin", quiet=True)
    name = os.path.splitext(os.path.basename(cache))[0]
    transform = cmds.createNode("transform", name=name)
    shape = cmds.createNode("mayaUsdProxyShape", name=f"{name}Shape", parent=transform)
    cmds.setAttr(f"{shape}.filePath", cache, type="string")
    cmds.connectAttr("time1.outTime", f"{shape}.time")
    return shape


def _asked(kinds, mode):
    found = cmds.fileDialog2(fileFilter=kinds, fileMode=mode, caption="featherfx")
    return found[0] if found else None
