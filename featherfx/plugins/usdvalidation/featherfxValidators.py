"""The rules of `featherfx check` for caches, as USD's own validators; featherfx must be importable.

Errors are named after what they are of, such as `points`, `extent`, `faceVertexIndices`, `kind`.
What follows from the rest of a cache has a fixer: extents, the default prim and its kind.
"""

from pxr import Kind, Sdf, Usd, UsdGeom, UsdValidation

from featherfx.usd.check.check import prim_problems, stage_problems

_NAME = "featherfxValidators"


def _error(stage, path, key, message):
    attribute = Sdf.Path(f"{path}.{key}") if Sdf.Path.IsValidPathString(f"{path}.{key}") else path
    site = UsdValidation.ValidationErrorSite(stage, attribute)
    kind = UsdValidation.ValidationErrorType.Error
    return UsdValidation.ValidationError(key, kind, [site], f"{key}: {message}")


def _check_stage(stage, times):
    root = Sdf.Path.absoluteRootPath
    return [
        _error(stage, root, key.rpartition(".")[2], message)
        for key, message in stage_problems(stage)
    ]


def _check_prim(prim, times):
    found = prim_problems(prim)
    return [_error(prim.GetStage(), prim.GetPath(), key, message) for key, message in found]


def _only_root(error):
    """The root prim that a stage without a default prim means, if there is one alone."""
    roots = error.GetSites()[0].GetStage().GetPseudoRoot().GetChildren()
    return roots[0] if len(roots) == 1 else None


def _fix_default_prim(error, edit_target, time):
    stage, root = error.GetSites()[0].GetStage(), _only_root(error)
    if root is not None:
        stage.SetDefaultPrim(root)
    return root is not None


def _fix_kind(error, edit_target, time):
    stage = error.GetSites()[0].GetStage()
    with Usd.EditContext(stage, edit_target):
        return Usd.ModelAPI(stage.GetDefaultPrim()).SetKind(Kind.Tokens.component)


def _fix_extent(error, edit_target, time):
    """Extents of the points at every sample, and at rest."""
    site = error.GetSites()[0]
    prim = site.GetPrim() or site.GetProperty().GetPrim()
    boundable, points = UsdGeom.Boundable(prim), UsdGeom.PointBased(prim).GetPointsAttr()
    codes = [Usd.TimeCode(code) for code in points.GetTimeSamples()] + [Usd.TimeCode.Default()]
    found = [(code, UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, code)) for code in codes]
    attribute = boundable.CreateExtentAttr()
    with Usd.EditContext(prim.GetStage(), edit_target):
        return all(attribute.Set(extent, code) for code, extent in found if extent is not None)


def _fixer(key, name, told, fix, can_fix=lambda error, edit_target, time: True):
    """key: name of the errors that it is for."""
    return UsdValidation.ValidationFixer(name, told, fix, can_fix, ["featherfx"], key)


_OF_STAGE = [
    _fixer(
        "defaultPrim",
        "NameDefaultPrim",
        "Makes the only root prim the default prim.",
        _fix_default_prim,
        lambda error, edit_target, time: _only_root(error) is not None,
    ),
    _fixer("kind", "SetKind", "Makes the default prim a component.", _fix_kind),
]
_OF_GEOMETRY = [_fixer("extent", "ComputeExtent", "Computes extents of the points.", _fix_extent)]

_registry = UsdValidation.ValidationRegistry()
_registry.RegisterPluginStageValidator(f"{_NAME}:CacheStage", _check_stage, _OF_STAGE)
_registry.RegisterPluginPrimValidator(f"{_NAME}:CacheGeometry", _check_prim, _OF_GEOMETRY)
_registry.RegisterPluginPrimValidator(f"{_NAME}:CacheInstances", _check_prim)
