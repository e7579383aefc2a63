"""Preview materials of vane and shaft; look development replaces them by binding others."""

from __future__ import annotations

from typing import Any

from pxr import Gf, Sdf, UsdShade

COLOURS = {"vane": (0.80, 0.76, 0.69), "rachis": (0.42, 0.33, 0.24)}
_ROUGHNESS = {"vane": 0.65, "rachis": 0.4}


def define_materials(stage: Any, scope: Any) -> dict[str, Any]:
    """UsdPreviewSurface materials "vane" and "rachis" under the path scope."""
    return {name: _define(stage, scope.AppendChild(name), name) for name in COLOURS}


def _define(stage: Any, path: Any, name: str) -> Any:
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path.AppendChild("surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    colour = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    colour.Set(Gf.Vec3f(*COLOURS[name]))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(_ROUGHNESS[name])
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return material


def bind(prim: Any, material: Any) -> None:
    """Bind a material to a prim (mesh, curves or subset)."""
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)
