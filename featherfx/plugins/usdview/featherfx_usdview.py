"""featherfx in usdview: bake a shot, colour by barb direction, tell what a stage holds."""

import featherfx_host
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt
from pxr.Usdviewq.plugin import PluginContainer

DIRECTION = "primvars:barbDirection"


class FeatherfxContainer(PluginContainer):
    """The menu "featherfx" and what stands in it."""

    def registerPlugins(self, plugRegistry, usdviewApi):
        register = plugRegistry.registerCommandPlugin
        self._commands = [
            register("featherfx.bake", "Bake shot...", bake_shot),
            register("featherfx.directions", "Colour by barb direction", show_directions),
            register("featherfx.plain", "Own colours", show_plain),
            register("featherfx.report", "Report of the stage", show_report),
        ]

    def configureView(self, plugRegistry, plugUIBuilder):
        menu = plugUIBuilder.findOrCreateMenu("featherfx")
        for each in self._commands:
            menu.addItem(each)


Tf.Type.Define(FeatherfxContainer)


def bake_shot(api):
    """Ask for a shot, bake it beside itself, and open the cache."""
    from pxr.Usdviewq.qt import QtWidgets

    shot, _ = QtWidgets.QFileDialog.getOpenFileName(api.qMainWindow, "Shot", "", "*.toml")
    if not shot:
        return
    output = shot.rpartition(".")[0] + ".usdc"
    run = featherfx_host.bake(shot, output)
    try:
        for told in run:
            percent = round(100 * featherfx_host.share_done(told))
            api.PrintStatus(f"featherfx: {told['phase']} {percent} %")
            QtWidgets.QApplication.processEvents()
        run.finish()
    except featherfx_host.HostError as error:
        QtWidgets.QMessageBox.critical(api.qMainWindow, "featherfx", str(error))
        return
    api.PrintStatus(f"featherfx: {output} is complete; open it with File, Open")


def show_directions(api):
    """Colours of the session that tell where barbs point at the frame that is shown."""
    with Usd.EditContext(api.stage, api.stage.GetSessionLayer()):
        meshes = [each for each in api.stage.Traverse() if each.IsA(UsdGeom.Mesh)]
        for prim in meshes:
            directions = prim.GetAttribute(DIRECTION).Get(api.frame)
            if directions:
                colours = Vt.Vec3fArray([Gf.Vec3f(*(0.5 + 0.5 * k for k in d)) for d in directions])
                primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
                    "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.uniform
                )
                primvar.Set(colours)
    api.UpdateGUI()


def show_plain(api):
    """Take those colours away."""
    layer = api.stage.GetSessionLayer()
    with Usd.EditContext(api.stage, layer):
        for prim in api.stage.Traverse():
            if layer.GetAttributeAtPath(prim.GetPath().AppendProperty("primvars:displayColor")):
                prim.RemoveProperty("primvars:displayColor")
    api.UpdateGUI()


def show_report(api):
    """Show the report of featherfx about the file of the stage."""
    from pxr.Usdviewq.qt import QtWidgets

    try:
        told = featherfx_host.report(api.stageIdentifier)
        counts = {}
        for prim in told["prims"]:
            counts[prim["kind"]] = counts.get(prim["kind"], 0) + 1
        text = "\n".join(f"{kind}: {count}" for kind, count in counts.items())
    except featherfx_host.HostError as error:
        text = str(error)
    QtWidgets.QMessageBox.information(api.qMainWindow, "featherfx", text or "nothing to simulate")
