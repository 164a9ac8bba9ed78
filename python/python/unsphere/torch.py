"""The differentiable functions of `unsphere` on PyTorch's tensors, with gradients by `torch.autograd`.

>>> import torch, unsphere as us, unsphere.torch as ut
>>> ball = us.icosphere(3)
>>> topology, matrices = ball.topology(), torch.from_numpy(us.matrices([camera]))
>>> vertices = torch.from_numpy(ball.vertices).requires_grad_()
>>> frame = ut.rasterize(ut.project(vertices, matrices), topology, 64, 64)
>>> loss = 0.5 * ut.mask_iou(ut.soft_silhouette(frame), target) + 10 * ut.l2(ut.antialiased_silhouette(frame), target)
>>> loss = loss + ut.laplacian_norm(vertices, topology)
>>> loss.backward()

The soft silhouette pulls from afar but is larger than the mesh, so that alone it makes the mesh too small; the other one is exact and pulls within a
pixel. target: what a mask shows, [N, H, W] in [0, 1].

Names, shapes and arguments are those of `unsphere`, without `wrt`: of which inputs gradients are wanted, PyTorch knows. Tensors are on the CPU,
float32 or float64, all of a call alike; they go in by `.numpy()` and come out by `from_numpy`, so nothing is copied on the way. What the
gradient needs is kept by the library. There are no second derivatives.

Arrays of `unsphere` itself (`Recorded.value`, `Frame.depth`) are read-only, of which PyTorch warns: `torch.from_numpy(result.value.copy())`.
"""

from dataclasses import dataclass as _dataclass

import numpy as _np
import torch as _torch
from torch.autograd.function import once_differentiable as _once_differentiable

import unsphere as _us

__all__ = [
    "Frame",
    "antialiased_silhouette",
    "chamfer",
    "chamfer_l1",
    "chamfer_normals",
    "deformation_norm",
    "depth",
    "earth_mover",
    "edge_length",
    "edge_length_sum",
    "face_angle",
    "face_normals",
    "face_point_distance",
    "interpolate",
    "interpolate_corners",
    "knn_points",
    "l1",
    "l2",
    "laplacian_cotangent",
    "laplacian_cotcurv",
    "laplacian_norm",
    "laplacian_squared",
    "log_depth",
    "mask_bce",
    "mask_iou",
    "neighbors",
    "normal_consistency",
    "point_face_distance",
    "point_mesh_face_distance",
    "project",
    "rasterize",
    "scale_shift_invariant",
    "soft_silhouette",
    "ssim_loss",
    "surface_normals",
    "surface_points",
    "texture",
    "vertex_normals",
]


class _Writable:
    """Memory of the library as PyTorch takes it: it has no tensors that are read-only."""

    def __init__(self, array):
        self.array = array
        interface = dict(array.__array_interface__)
        interface["data"] = (interface["data"][0], False)
        self.__array_interface__ = interface


def _check(tensor, name):
    if not isinstance(tensor, _torch.Tensor):
        kind = type(tensor)
        found = "numpy.ndarray" if kind is _np.ndarray else kind.__qualname__
        hint = "torch.from_numpy(...)" if kind is _np.ndarray else "torch.tensor(...)"
        raise TypeError(f"{name}: a torch.Tensor expected, found a {found}; {hint} makes one")
    if tensor.device.type != "cpu":
        raise ValueError(f"{name}: a tensor on the CPU expected, found one on {tensor.device}")


def _numpy(tensor, name):
    _check(tensor, name)
    return tensor.detach().numpy()


class _Function(_torch.autograd.Function):
    """A function of `unsphere` on the tape of PyTorch."""

    @staticmethod
    def forward(ctx, call, names, *tensors):
        wanted = [name for name, needed in zip(names, ctx.needs_input_grad[2:]) if needed]
        made = call([tensor.detach().numpy() for tensor in tensors], wanted)
        ctx.made = made
        if isinstance(made.value, float):
            return _torch.tensor(made.value, dtype=tensors[0].dtype)
        value = _torch.from_numpy(_np.asarray(_Writable(made.value)))
        # The library may need it on the way back: saved, PyTorch sees to it that nobody changes it in place meanwhile.
        ctx.save_for_backward(value)
        return value

    @staticmethod
    @_once_differentiable
    def backward(ctx, cotangent):
        saved = ctx.saved_tensors
        gradients = ctx.made.backward(cotangent.detach().numpy() if saved else float(cotangent))
        return (None, None, *(g if g is None else _torch.from_numpy(g) for g in gradients))


def _apply(op, names, tensors, call):
    """`call(arrays, wanted)` on the tape; names and tensors are those of its differentiable inputs."""
    for name, tensor in zip(names, tensors):
        _check(tensor, f"{op}: {name}")
    return _Function.apply(call, names, *tensors)


def project(points, matrices, *, perspective=True):
    """Points through cameras, to NDC and planar depth. See `unsphere.project`."""
    return _apply(
        "project",
        ("points", "matrices"),
        (points, matrices),
        lambda arrays, wrt: _us.project(*arrays, perspective=perspective, wrt=wrt),
    )


@_dataclass(frozen=True)
class Frame:
    """What is seen of a batch of meshes: the projected positions, and `unsphere.Frame`, whose arrays are properties here: tensors without gradients."""

    projected: _torch.Tensor
    seen: _us.Frame

    @property
    def shape(self) -> "list[int]":
        """N, H, W."""
        return self.seen.shape

    @property
    def topology(self) -> _us.Topology:
        """The faces that were drawn."""
        return self.seen.topology

    @property
    def face(self) -> _torch.Tensor:
        """The nearest face at each pixel, int64 [N, H, W]; -1 at background."""
        return _torch.from_numpy(self.seen.face)

    @property
    def barycentric(self) -> _torch.Tensor:
        """Its barycentric coordinates, [N, H, W, 3]; 0 at background. A copy."""
        return _torch.from_numpy(self.seen.barycentric.copy())

    @property
    def depth(self) -> _torch.Tensor:
        """Its planar depth, [N, H, W]; inf at background. A copy; the function `depth` has gradients."""
        return _torch.from_numpy(self.seen.depth.copy())

    @property
    def mask(self) -> _torch.Tensor:
        """1 where a face is seen, else 0, [N, H, W]; `soft_silhouette` and `antialiased_silhouette` have gradients."""
        return _torch.from_numpy(self.seen.mask)


def rasterize(projected, topology, height, width, **settings):
    """Finds what is seen at each pixel. See `unsphere.rasterize`."""
    return Frame(projected, _us.rasterize(_numpy(projected, "rasterize: projected"), topology, height, width, **settings))


def interpolate(frame, attributes):
    """Attributes of the vertices at each pixel. See `unsphere.interpolate`."""
    return _apply(
        "interpolate",
        ("projected", "attributes"),
        (frame.projected, attributes),
        lambda arrays, wrt: _us.interpolate(frame.seen, arrays[1], wrt=wrt),
    )


def interpolate_corners(frame, attributes):
    """Attributes of the corners of faces at each pixel. See `unsphere.interpolate_corners`."""
    return _apply(
        "interpolate_corners",
        ("projected", "attributes"),
        (frame.projected, attributes),
        lambda arrays, wrt: _us.interpolate_corners(frame.seen, arrays[1], wrt=wrt),
    )


def soft_silhouette(frame):
    """DIB-R's soft silhouette: pulls from afar, but is larger than the mesh. See `unsphere.soft_silhouette`."""
    return _apply("soft_silhouette", ("projected",), (frame.projected,), lambda _, wrt: _us.soft_silhouette(frame.seen, wrt=wrt))


def antialiased_silhouette(frame):
    """Coverage with the sub-pixel position of the silhouette: exact, pulls within a pixel. See `unsphere.antialiased_silhouette`."""
    return _apply("antialiased_silhouette", ("projected",), (frame.projected,), lambda _, wrt: _us.antialiased_silhouette(frame.seen, wrt=wrt))


def depth(frame, background=0.0):
    """Planar depth at each pixel. See `unsphere.depth`."""
    return _apply("depth", ("projected",), (frame.projected,), lambda _, wrt: _us.depth(frame.seen, background, wrt=wrt))


def texture(frame, uv, image):
    """Colours of a texture at each pixel. See `unsphere.texture`."""
    return _apply("texture", ("uv", "image"), (uv, image), lambda arrays, wrt: _us.texture(frame.seen, *arrays, wrt=wrt))


def _of_mesh(name):
    """A function of positions and a topology."""
    function = getattr(_us, name)

    def of_mesh(positions, topology):
        return _apply(name, ("positions",), (positions,), lambda arrays, wrt: function(arrays[0], topology, wrt=wrt))

    of_mesh.__name__ = of_mesh.__qualname__ = name
    of_mesh.__doc__ = function.__doc__
    return of_mesh


edge_length_sum = _of_mesh("edge_length_sum")
face_angle = _of_mesh("face_angle")
face_normals = _of_mesh("face_normals")
laplacian_cotangent = _of_mesh("laplacian_cotangent")
laplacian_cotcurv = _of_mesh("laplacian_cotcurv")
laplacian_norm = _of_mesh("laplacian_norm")
laplacian_squared = _of_mesh("laplacian_squared")
normal_consistency = _of_mesh("normal_consistency")
vertex_normals = _of_mesh("vertex_normals")


def edge_length(positions, topology, target=0.0):
    """The mean squared deviation of the edges' lengths from `target`. See `unsphere.edge_length`."""
    return _apply(
        "edge_length",
        ("positions",),
        (positions,),
        lambda arrays, wrt: _us.edge_length(arrays[0], topology, target, wrt=wrt),
    )


def deformation_norm(offsets):
    """The mean length of the offsets. See `unsphere.deformation_norm`."""
    return _apply("deformation_norm", ("offsets",), (offsets,), lambda arrays, wrt: _us.deformation_norm(*arrays, wrt=wrt))


def surface_points(positions, topology, samples):
    """Where samples of a surface are. See `unsphere.surface_points`."""
    return _apply(
        "surface_points",
        ("positions",),
        (positions,),
        lambda arrays, wrt: _us.surface_points(arrays[0], topology, samples, wrt=wrt),
    )


def surface_normals(positions, topology, samples):
    """Unit normals at samples of a surface. See `unsphere.surface_normals`."""
    return _apply(
        "surface_normals",
        ("positions",),
        (positions,),
        lambda arrays, wrt: _us.surface_normals(arrays[0], topology, samples, wrt=wrt),
    )


def chamfer(x, y, *, x_to_y=1.0, y_to_x=1.0):
    """The Chamfer distance, squared. See `unsphere.chamfer`."""
    return _apply(
        "chamfer",
        ("x", "y"), (x, y), lambda arrays, wrt: _us.chamfer(*arrays, x_to_y=x_to_y, y_to_x=y_to_x, wrt=wrt)
    )


def chamfer_l1(x, y, *, x_to_y=1.0, y_to_x=1.0):
    """The Chamfer distance of absolute differences. See `unsphere.chamfer_l1`."""
    return _apply(
        "chamfer_l1",
        ("x", "y"), (x, y), lambda arrays, wrt: _us.chamfer_l1(*arrays, x_to_y=x_to_y, y_to_x=y_to_x, wrt=wrt)
    )


def chamfer_normals(x, y, x_normals, y_normals, *, signed=False, x_to_y=1.0, y_to_x=1.0):
    """1 - |cos| of the normals at nearest points; no gradient to x and y. See `unsphere.chamfer_normals`."""
    known = _numpy(x, "chamfer_normals: x"), _numpy(y, "chamfer_normals: y")
    settings = {"signed": signed, "x_to_y": x_to_y, "y_to_x": y_to_x}
    return _apply(
        "chamfer_normals",
        ("x_normals", "y_normals"),
        (x_normals, y_normals),
        lambda arrays, wrt: _us.chamfer_normals(*known, *arrays, **settings, wrt=wrt),
    )


def knn_points(x, y, k, *, norm=2):
    """Distances to the k nearest points, squared. See `unsphere.knn_points`."""
    return _apply("knn_points", ("x", "y"), (x, y), lambda arrays, wrt: _us.knn_points(*arrays, k, norm=norm, wrt=wrt))


def neighbors(x, y, k, *, norm=2):
    """Which points these are, int64: `values[indices]` carries gradients. See `unsphere.neighbors`."""
    return _torch.from_numpy(_us.neighbors(_numpy(x, "neighbors: x"), _numpy(y, "neighbors: y"), k, norm=norm))


def earth_mover(x, y, *, excess=None):
    """The earth mover's distance. See `unsphere.earth_mover`."""
    return _apply("earth_mover", ("x", "y"), (x, y), lambda arrays, wrt: _us.earth_mover(*arrays, excess=excess, wrt=wrt))


def _to_surface(name):
    """A function of points, positions and a topology."""
    function = getattr(_us, name)

    def to_surface(x, positions, topology):
        return _apply(name, ("x", "positions"), (x, positions), lambda arrays, wrt: function(*arrays, topology, wrt=wrt))

    to_surface.__name__ = to_surface.__qualname__ = name
    to_surface.__doc__ = function.__doc__
    return to_surface


face_point_distance = _to_surface("face_point_distance")
point_face_distance = _to_surface("point_face_distance")
point_mesh_face_distance = _to_surface("point_mesh_face_distance")


def _masked(function, image, target, mask):
    if mask is None:
        return _apply(function.__name__, ("image", "target"), (image, target), lambda arrays, wrt: function(*arrays, wrt=wrt))
    names = ("image", "target", "mask")
    return _apply(function.__name__, names, (image, target, mask), lambda arrays, wrt: function(*arrays, wrt=wrt))


def l1(image, target, mask=None):
    """The mean absolute difference. See `unsphere.l1`."""
    return _masked(_us.l1, image, target, mask)


def l2(image, target, mask=None):
    """The mean squared difference. See `unsphere.l2`."""
    return _masked(_us.l2, image, target, mask)


def ssim_loss(image, target, *, valid=False):
    """1 - SSIM. See `unsphere.ssim_loss`."""
    return _apply(
        "ssim_loss",
        ("image", "target"), (image, target), lambda arrays, wrt: _us.ssim_loss(*arrays, valid=valid, wrt=wrt)
    )


def mask_iou(prediction, target):
    """1 - intersection over union of soft masks. See `unsphere.mask_iou`."""
    return _apply("mask_iou", ("prediction", "target"), (prediction, target), lambda arrays, wrt: _us.mask_iou(*arrays, wrt=wrt))


def mask_bce(prediction, target):
    """The mean binary cross entropy of masks; no gradient to the target. See `unsphere.mask_bce`."""
    known = _numpy(target, "mask_bce: target")
    return _apply("mask_bce", ("prediction",), (prediction,), lambda arrays, wrt: _us.mask_bce(arrays[0], known, wrt=wrt))


def log_depth(prediction, target, mask, weight=0.5):
    """Eigen's loss of the logarithms of depth; no gradient to target and mask. See `unsphere.log_depth`."""
    known = _numpy(target, "log_depth: target"), _numpy(mask, "log_depth: mask")
    return _apply(
        "log_depth",
        ("prediction",), (prediction,), lambda arrays, wrt: _us.log_depth(arrays[0], *known, weight, wrt=wrt)
    )


def scale_shift_invariant(prediction, target, mask, *, robust=False, gradient_weight=0.5, scales=4):
    """MiDaS's loss between disparities; no gradient to target and mask. See `unsphere.scale_shift_invariant`."""
    op = "scale_shift_invariant"
    known = _numpy(target, f"{op}: target"), _numpy(mask, f"{op}: mask")
    settings = {"robust": robust, "gradient_weight": gradient_weight, "scales": scales}
    return _apply(
        "scale_shift_invariant",
        ("prediction",),
        (prediction,),
        lambda arrays, wrt: _us.scale_shift_invariant(arrays[0], *known, **settings, wrt=wrt),
    )
