"""Figures: how good images, masks, points and meshes are. No gradients here."""

import json as _json
from typing import Any as _Any

from ._unsphere import Mesh as _Mesh
from ._unsphere import evaluate as _evaluate
from ._unsphere import iou, point_distances, psnr, ssim, voxel_iou

__all__ = ["evaluate", "iou", "point_distances", "psnr", "ssim", "voxel_iou"]


def evaluate(prediction: _Mesh, truth: _Mesh, protocol: str = "meshrcnn", seed: int = 0) -> "dict[str, _Any]":
    """Compares two meshes under a published protocol, which is part of the answer.

    protocol: "p2m" (Pixel2Mesh), "meshrcnn" (Mesh R-CNN), "occnet" (Occupancy Networks) or "mcmr" (3D IoU). seed: of the points that are drawn.

    Result: a dict of `protocol` and the figures that it has, else None: `chamfer`, `accuracy`, `completeness`, `f_scores`, `normal_consistency`, `iou`.
    """
    found: dict[str, _Any] = _json.loads(_evaluate(prediction, truth, protocol, seed))
    return found
