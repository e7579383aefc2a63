"""The rules of `featherfx check` for caches, as USD's own validators; featherfx must be importable.

Errors are named after what they are of, such as `points`, `extent`, `faceVertexIndices`, `kind`.
"""

from pxr import Sdf, UsdValidation

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


_registry = UsdValidation.ValidationRegistry()
_registry.RegisterPluginStageValidator(f"{_NAME}:CacheStage", _check_stage)
for _name in ("CacheGeometry", "CacheInstances"):
    _registry.RegisterPluginPrimValidator(f"{_NAME}:{_name}", _check_prim)
