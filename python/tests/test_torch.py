"""`unsphere.torch` beside PyTorch's own gradients of the definitions, and beside NumPy's way back."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import plain
import unsphere as us
import unsphere.torch as ut
from scene import BOX, SIGMA, SIZE, Scene

# Relative to the largest gradient.
TOLERANCES = {np.float64: 1e-6, np.float32: 1e-4}


@pytest.fixture(params=TOLERANCES, ids=["float64", "float32"])
def scene(request):
    made = Scene(request.param)
    made.tolerance = TOLERANCES[request.param]
    return made


def index(array):
    return torch.as_tensor(np.asarray(array), dtype=torch.long)


def compare(scene, ours, theirs, *arrays):
    """Values and gradients of two functions of tensors."""
    random, found = torch.Generator().manual_seed(0), []
    for function in (ours, theirs):
        inputs = [torch.tensor(array, requires_grad=True) for array in arrays]
        value = function(*inputs)
        if not found:
            cotangent = torch.randn(value.shape, generator=random, dtype=value.dtype)
        value.backward(cotangent)
        found.append([value.detach(), *(x.grad for x in inputs)])
    for a, b in zip(*found):
        assert a.dtype == b.dtype and a.shape == b.shape
        assert (a - b).abs().max() <= scene.tolerance * (1 + b.abs().max())


def at_pixels(scene, value):
    image, row, column, _ = map(index, scene.pixels)
    return value[image, row, column]


def seen(scene, projected):
    return ut.rasterize(projected, scene.topology, *SIZE, sigma_inv=SIGMA, box_length=BOX)


def test_project(scene):
    compare(scene, ut.project, lambda p, m: plain.project(torch, p, m), scene.vertices, scene.matrices)


def test_interpolate(scene):
    faces, pixels, centres = index(scene.faces), [index(x) for x in scene.pixels], torch.tensor(scene.centres)
    compare(
        scene,
        lambda p, c: at_pixels(scene, ut.interpolate(seen(scene, p), c)),
        lambda p, c: plain.interpolate(torch, p, faces, pixels, centres, c),
        scene.projected,
        scene.colors,
    )


def test_depth(scene):
    faces, pixels, centres = index(scene.faces), [index(x) for x in scene.pixels], torch.tensor(scene.centres)
    compare(
        scene,
        lambda p: at_pixels(scene, ut.depth(seen(scene, p))),
        lambda p: plain.weights(torch, p, faces, pixels, centres)[1],
        scene.projected,
    )


def test_soft_silhouette(scene):
    faces, grid, covered = index(scene.faces), torch.tensor(scene.grid), torch.tensor(scene.frame.mask)
    compare(
        scene,
        lambda p: ut.soft_silhouette(seen(scene, p)),
        lambda p: torch.stack([plain.soft_silhouette(torch, p[i], faces, grid, covered[i], SIGMA, BOX) for i in range(2)]),
        scene.projected,
    )


def test_texture(scene):
    frame = seen(scene, torch.tensor(scene.projected))
    compare(
        scene,
        lambda uv, image: at_pixels(scene, ut.texture(frame, uv, image)),
        lambda uv, image: plain.texture(torch, at_pixels(scene, uv), image, lambda x: x.detach().long()),
        scene.uv,
        scene.image,
    )


def test_losses(scene):
    compare(scene, ut.chamfer, lambda x, y: plain.chamfer(torch, x, y), scene.points, scene.vertices)
    compare(scene, ut.mask_iou, lambda a, b: plain.mask_iou(torch, a, b), scene.masks, scene.masks[::-1].copy())
    compare(scene, ut.l1, lambda a, b: plain.l1(torch, a, b), scene.photos, 1 - scene.photos**2)
    compare(scene, ut.l2, lambda a, b: plain.l2(torch, a, b), scene.photos, 1 - scene.photos**2)
    y, topology = scene.vertices, scene.topology
    edges, pairs, adjacency = index(scene.edges), index(scene.pairs), torch.tensor(scene.adjacency)
    compare(scene, lambda x: ut.edge_length(x, topology, 0.3), lambda x: plain.edge_length(torch, x, edges, 0.3), y)
    compare(scene, lambda x: ut.laplacian_norm(x, topology), lambda x: plain.laplacian_norm(torch, x, adjacency), y)
    compare(scene, lambda x: ut.normal_consistency(x, topology), lambda x: plain.normal_consistency(torch, x, pairs), y)
    weights = torch.tensor(plain.cotangents(y, scene.faces))
    compare(scene, lambda x: ut.laplacian_cotangent(x, topology), lambda x: plain.laplacian_norm(torch, x, weights), y)
    corner = index(scene.faces[scene.samples.face])
    share = torch.tensor(scene.samples.barycentric.astype(scene.dtype))
    compare(
        scene,
        lambda x: ut.surface_points(x, topology, scene.samples),
        lambda x: plain.surface_points(torch, x, corner, share),
        y,
    )


def test_nearest_points(scene):
    x, y = scene.points, scene.vertices
    for norm in (1, 2):
        near = ut.neighbors(torch.tensor(x), torch.tensor(y), 4, norm=norm)
        assert near.dtype == torch.int64 and np.array_equal(near.numpy(), us.neighbors(x, y, 4, norm=norm))
        compare(scene, lambda x, y: ut.knn_points(x, y, 4, norm=norm), lambda x, y: plain.knn_points(torch, x, y, near, norm), x, y)
    there, back = (ut.neighbors(torch.tensor(a), torch.tensor(b), 1)[:, 0] for a, b in [(x, y), (y, x)])
    points = torch.tensor(x), torch.tensor(y)
    for signed in (False, True):
        compare(
            scene,
            lambda m, n: ut.chamfer_normals(*points, m, n, signed=signed),
            lambda m, n: plain.chamfer_normals(torch, m, n, there, back, signed),
            np.cos(7 * x),
            np.cos(9 * y),
        )


def test_the_rest_is_numpys_way_back():
    """What has no plain twin here passes NumPy's gradients, which test_gradients.py holds, on to PyTorch."""
    scene = Scene(np.float64)
    topology, samples = scene.topology, scene.samples
    for name in "laplacian_squared laplacian_cotcurv face_angle edge_length_sum face_normals vertex_normals".split():
        by_hand(getattr(ut, name), getattr(us, name), [scene.vertices], topology)
    by_hand(ut.surface_normals, us.surface_normals, [scene.vertices], topology, samples)
    by_hand(ut.deformation_norm, us.deformation_norm, [scene.vertices])
    for name in "point_mesh_face_distance point_face_distance face_point_distance".split():
        by_hand(getattr(ut, name), getattr(us, name), [scene.points, scene.vertices], topology)
    by_hand(ut.chamfer_l1, us.chamfer_l1, [scene.points, scene.vertices])
    by_hand(ut.earth_mover, us.earth_mover, [scene.points[:42], scene.vertices])
    by_hand(ut.ssim_loss, us.ssim_loss, [scene.photos, 1 - scene.photos])
    by_hand(ut.l2, us.l2, [scene.photos, 1 - scene.photos, scene.masks])
    ones = np.ones_like(scene.masks)
    for name in ["log_depth", "scale_shift_invariant"]:
        own, other = getattr(ut, name), getattr(us, name)
        by_hand(lambda p: own(p, torch.tensor(ones + scene.masks), torch.tensor(ones)), lambda p: other(p, ones + scene.masks, ones), [ones + scene.masks**2])
    by_hand(lambda p: ut.mask_bce(p, torch.tensor(ones)), lambda p: us.mask_bce(p, ones), [scene.masks])
    by_hand(
        lambda p: ut.antialiased_silhouette(seen(scene, p)),
        lambda p: us.antialiased_silhouette(us.rasterize(p, topology, *SIZE)),
        [scene.projected],
    )
    corners = np.random.default_rng(0).uniform(size=(len(scene.faces), 3, 2))
    by_hand(
        lambda p, c: ut.interpolate_corners(seen(scene, p), c),
        lambda p, c: us.interpolate_corners(us.rasterize(p, topology, *SIZE), c),
        [scene.projected, corners],
    )


def by_hand(function, other, arrays, *rest):
    inputs = [torch.tensor(array, requires_grad=True) for array in arrays]
    value, made = function(*inputs, *rest), other(*arrays, *rest)
    assert np.array_equal(value.detach().numpy(), made.value)
    cotangent = np.random.default_rng(1).standard_normal(np.shape(made.value))
    value.backward(torch.tensor(cotangent))
    for x, gradient in zip(inputs, made.backward(cotangent if cotangent.ndim else float(cotangent))):
        assert np.allclose(x.grad.numpy(), gradient, rtol=1e-12, atol=1e-15)


def test_nothing_is_copied():
    scene = Scene(np.float32)
    frame = seen(scene, torch.tensor(scene.projected))
    image = ut.depth(frame)
    seen_by_numpy = frame.seen.depth
    assert torch.from_numpy(np.array(seen_by_numpy)).shape == image.shape
    # A tensor over the library's memory, which lives on when everything else is gone.
    before = image.clone()
    del frame
    for _ in range(20):
        ut.depth(seen(scene, torch.tensor(scene.projected)))
    assert torch.equal(image, before)


def test_only_what_needs_a_gradient_has_one():
    scene = Scene(np.float32)
    image, target = torch.tensor(scene.photos, requires_grad=True), torch.tensor(scene.photos[::-1].copy())
    loss = ut.l2(image, target)
    loss.backward()
    assert image.grad is not None and target.grad is None
    assert not ut.l2(target, target).requires_grad


def test_a_result_that_was_changed_in_place_is_refused():
    scene = Scene(np.float32)
    projected = torch.tensor(scene.projected, requires_grad=True)
    image = ut.interpolate(seen(scene, projected), torch.tensor(scene.colors))
    image.mul_(2)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        image.sum().backward()


def test_no_second_derivatives():
    x = torch.tensor(Scene(np.float64).vertices, requires_grad=True)
    (gradient,) = torch.autograd.grad(ut.deformation_norm(x), x, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable|does not require grad"):
        gradient.sum().backward()


def test_arrays_are_told_from_tensors():
    scene = Scene(np.float32)
    points, matrices = torch.tensor(scene.vertices), torch.tensor(scene.matrices)
    with pytest.raises(TypeError, match=r"project: points: a torch.Tensor expected, found a numpy.ndarray; torch.from_numpy"):
        ut.project(scene.vertices, matrices)
    with pytest.raises(TypeError, match="project: matrices: a torch.Tensor expected, found a numpy.ndarray"):
        ut.project(points, scene.matrices)
    with pytest.raises(TypeError, match="l2: target: a torch.Tensor expected, found a float"):
        ut.l2(points, 0.5)
    with pytest.raises(TypeError, match="mask_bce: target: a torch.Tensor expected"):
        ut.mask_bce(torch.tensor(scene.masks), scene.masks)
    with pytest.raises(TypeError, match="laplacian_norm: positions: a torch.Tensor expected"):
        ut.laplacian_norm(scene.vertices, scene.topology)
    with pytest.raises(TypeError, match="float64 expected, found a torch.Tensor; unsphere.torch takes tensors"):
        us.project(points, scene.matrices)


def test_a_frame_has_what_is_seen():
    scene = Scene(np.float32)
    frame = seen(scene, torch.tensor(scene.projected, requires_grad=True))
    for name in "face barycentric depth mask".split():
        found = getattr(frame, name)
        assert not found.requires_grad and np.array_equal(found.numpy(), getattr(scene.frame, name)), name
        found += 1  # the caller's own
        assert np.array_equal(getattr(frame, name).numpy(), getattr(scene.frame, name))
    assert frame.shape == scene.frame.shape and frame.topology is scene.topology


def test_the_soft_silhouette_alone_makes_a_mesh_too_small():
    """What the README says to add up, on lesson 1's vase."""
    from test_lessons import lesson

    module = lesson("fit_a_mesh")
    truth, matrices = module.vase(), module.cameras()
    masks, _ = module.draw(truth.vertices, truth.colors, truth.topology(), matrices)
    target, ious = torch.tensor(masks), []
    for outline in (0, 10):
        start, _, topology = module.start()
        vertices = torch.tensor(start, requires_grad=True)
        adam = torch.optim.Adam([vertices], lr=0.01)
        for _ in range(100):
            adam.zero_grad()
            frame = ut.rasterize(ut.project(vertices, torch.tensor(matrices)), topology, module.SIZE, module.SIZE)
            loss = 0.5 * ut.mask_iou(ut.soft_silhouette(frame), target) + outline * ut.l2(ut.antialiased_silhouette(frame), target)
            (loss + ut.laplacian_norm(vertices, topology)).backward()
            adam.step()
        ious.append(1 - ut.mask_iou(frame.mask, (target > 0.5).float()).item())
    assert ious[0] < ious[1] and ious[1] > 0.97


def test_lesson_one_has_the_same_gradients():
    from test_lessons import lesson

    module = lesson("fit_a_mesh")
    truth, matrices = module.vase(), module.cameras()
    known = [matrices, *module.draw(truth.vertices, truth.colors, truth.topology(), matrices)]
    known = [array.astype(np.float64) for array in known]
    vertices, colors, topology = module.start()
    vertices, colors = vertices.astype(np.float64), colors.astype(np.float64)
    loss, *gradients = module.loss_and_gradients(vertices, colors, topology, *known)
    inputs = [torch.tensor(array, requires_grad=True) for array in (vertices, colors)]
    value = module.torch_loss(*inputs, topology, *map(torch.tensor, known))
    value.backward()
    assert value.item() == pytest.approx(loss, rel=1e-12)
    for x, gradient in zip(inputs, gradients):
        assert np.allclose(x.grad.numpy(), gradient, rtol=1e-9, atol=1e-12)
