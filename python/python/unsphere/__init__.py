"""Differentiable rendering, mesh losses, fits and differential equations on NumPy arrays, on the CPU.

A differentiable function returns a `Recorded`: `value`, and `backward(cotangent)`, which gives the gradients of its inputs. Chains go
backwards by hand:

>>> import numpy as np, unsphere as us
>>> ball = us.icosphere(2)
>>> topology = ball.topology()
>>> camera = us.Camera.look_at([0, 0, 3], [0, 0, 0], width=64, height=64)
>>> points, back_to_points = us.project(ball.vertices, us.matrices([camera]), wrt="points")
>>> frame = us.rasterize(points, topology, 64, 64)
>>> mask, back_to_projected = us.soft_silhouette(frame)
>>> loss, back_to_mask = us.mask_iou(mask, np.ones_like(mask), wrt="prediction")
>>> of_mask, _ = back_to_mask()
>>> of_vertices, _ = back_to_points(*back_to_projected(of_mask))
>>> of_vertices.shape
(162, 3)

`unsphere.torch` has the same functions on tensors, where PyTorch walks backwards.

Arrays are float32 or float64, all of a call alike; float64 is for tests. N is a batch, V vertices, F faces, P points, C channels, H and W rows and
columns. The world is right-handed with +Y up. Inputs are read where they lie, and what gradients need of them is kept beside: they may be
changed afterwards. Values that are arrays are read-only and share the memory of their `Recorded` (`value.copy()` is the caller's own). The
interpreter is free while a function works.

Wrong values and shapes: ValueError; wrong types and dtypes: TypeError; files: OSError.
"""

import json as _json
from collections.abc import Callable as _Callable
from os import PathLike as _PathLike
from typing import Optional as _Optional
from typing import Union as _Union

from . import _unsphere
from ._unsphere import (
    Camera,
    Fitted,
    Frame,
    Mesh,
    Recorded,
    Solution,
    SurfaceSamples,
    Topology,
    Views,
    antialiased_silhouette,
    chamfer,
    chamfer_l1,
    chamfer_normals,
    cubify,
    cuboid,
    deformation_norm,
    depth,
    earth_mover,
    edge_length,
    edge_length_sum,
    face_angle,
    face_normals,
    face_point_distance,
    icosphere,
    interpolate,
    interpolate_corners,
    knn_points,
    l1,
    l2,
    laplacian_cotangent,
    laplacian_cotcurv,
    laplacian_norm,
    laplacian_squared,
    lathe,
    log_depth,
    marching_cubes,
    mask_bce,
    mask_iou,
    matrices,
    neighbors,
    normal_consistency,
    odeint,
    point_face_distance,
    point_mesh_face_distance,
    project,
    rasterize,
    read_image,
    read_mesh,
    sample_surface,
    scale_shift_invariant,
    soft_silhouette,
    ssim_loss,
    surface_normals,
    surface_points,
    texture,
    torus,
    vertex_normals,
    write_mesh,
    write_png,
)
from . import metrics
from .adam import Adam

__version__ = _unsphere.__version__

__all__ = [
    "Adam",
    "Camera",
    "Fitted",
    "Frame",
    "Mesh",
    "Recorded",
    "Solution",
    "SurfaceSamples",
    "Topology",
    "Views",
    "antialiased_silhouette",
    "chamfer",
    "chamfer_l1",
    "chamfer_normals",
    "cubify",
    "cuboid",
    "deformation_norm",
    "depth",
    "earth_mover",
    "edge_length",
    "edge_length_sum",
    "face_angle",
    "face_normals",
    "face_point_distance",
    "fit",
    "icosphere",
    "interpolate",
    "interpolate_corners",
    "knn_points",
    "l1",
    "l2",
    "laplacian_cotangent",
    "laplacian_cotcurv",
    "laplacian_norm",
    "laplacian_squared",
    "lathe",
    "log_depth",
    "marching_cubes",
    "mask_bce",
    "mask_iou",
    "matrices",
    "metrics",
    "neighbors",
    "normal_consistency",
    "odeint",
    "point_face_distance",
    "point_mesh_face_distance",
    "project",
    "rasterize",
    "read_image",
    "read_mesh",
    "read_views",
    "sample_surface",
    "scale_shift_invariant",
    "soft_silhouette",
    "ssim_loss",
    "surface_normals",
    "surface_points",
    "texture",
    "torus",
    "vertex_normals",
    "write_mesh",
    "write_png",
]

_Path = _Union[str, "_PathLike[str]"]


def read_views(path: _Path, **options: object) -> Views:
    """Reads views of one object from whatever is at a path: a folder, a zip, a transforms.json, a COLMAP model and others.

    path: where. options: `max_size` (pixels of the longer side), `object` (its name, where there are several), `allow_missing` and the other fields of
    `ReadOptions` of the crate `datasets`.

    Raises OSError with the file, the field, what was found and what was expected.
    """
    return _unsphere.read_views(path, _json.dumps(options, default=_plain))


def fit(views: Views, callback: _Optional[_Callable[[int, int, float], object]] = None, **options: object) -> Fitted:
    """Fits a closed mesh with colours to views of one object.

    views: `Views`. callback: called with (step, total, loss) after each step, where total is the most steps there can be; if it returns False the fit
    ends early, with what there is. options: those of docs/options.md for `fit`, with underscores: `level` (5: 10,242 vertices), `steps` (150 at
    each level), `hold_out` (5: every fifth view is for scoring; None: none), `color` ("vertex" or "texture"), `seed` and others.

    Ctrl-C ends it after the step and raises KeyboardInterrupt; what a callback raises ends it too. Raises ValueError where views make no sense
    together.
    """
    return _unsphere.fit(views, [(name, _setting(value)) for name, value in options.items()], callback)


def _plain(value: object) -> object:
    """What a number of NumPy is to Python; of anything else its text."""
    item = getattr(value, "item", None)
    return item() if callable(item) else str(value)


def _setting(value: object) -> str:
    """A value as TOML has it."""
    value = _plain(value) if hasattr(value, "item") else value
    if value is None:
        return "none"
    return _json.dumps(value) if isinstance(value, (bool, int, float)) else str(value)
