"""Every gradient, in double precision, beside central differences; and in single precision beside double."""

import numpy as np
import pytest

import plain
import unsphere as us

STEP = 1e-6


def shaken(seed, level=1):
    """A ball that is none any more, its topology, and random numbers."""
    random = np.random.default_rng(seed)
    ball = us.icosphere(level)
    vertices = ball.vertices.astype(np.float64)
    return vertices + 0.05 * random.standard_normal(vertices.shape), ball.topology(), random


def cameras():
    eyes = [[0.3, 0.2, 3.0], [2.5, -0.4, 1.5]]
    return us.matrices([us.Camera.look_at(eye, [0, 0, 0], width=40, height=32) for eye in eyes], "float64")


def frame_of(projected, topology, **settings):
    return us.rasterize(projected, topology, 32, 40, **settings)


def mesh_cases():
    vertices, topology, random = shaken(0)
    batch = np.stack([vertices, vertices[:, ::-1]])
    names = "laplacian_norm laplacian_squared normal_consistency face_angle edge_length_sum face_normals vertex_normals".split()
    for name in names:
        yield name, lambda x, f=getattr(us, name): f(x, topology), [batch]
    yield "edge_length", lambda x: us.edge_length(x, topology, 0.3), [batch]
    yield "deformation_norm", us.deformation_norm, [vertices]
    samples = us.sample_surface(vertices, topology, 50, seed=3)
    yield "surface_points", lambda x: us.surface_points(x, topology, samples), [vertices]
    yield "surface_normals", lambda x: us.surface_normals(x, topology, samples), [vertices]
    points = 1.2 * random.standard_normal((30, 3))
    for name in ["point_mesh_face_distance", "point_face_distance", "face_point_distance"]:
        yield name, lambda p, x, f=getattr(us, name): f(p, x, topology), [points, vertices]


def point_cases():
    random = np.random.default_rng(1)
    x, y = random.standard_normal((2, 20, 3)), random.standard_normal((2, 35, 3))
    yield "chamfer", lambda x, y: us.chamfer(x, y, x_to_y=0.55), [x, y]
    yield "chamfer_l1", us.chamfer_l1, [x, y]
    yield "knn_points", lambda x, y: us.knn_points(x, y, 4), [x, y]
    yield "knn_points, norm 1", lambda x, y: us.knn_points(x, y, 3, norm=1), [x[0, :, :2], y[0, :, :2]]
    normals = [random.standard_normal(points.shape) for points in (x, y)]
    for name, options in {"chamfer_normals": {"y_to_x": 0.55}, "chamfer_normals, signed": {"signed": True}}.items():
        yield name, lambda m, n, o=options: us.chamfer_normals(x.astype(m.dtype), y.astype(m.dtype), m, n, **o), normals
    yield "earth_mover", us.earth_mover, [x[0], y[0, :20]]


def image_cases():
    random = np.random.default_rng(2)
    a, b = random.uniform(0.1, 0.9, (2, 2, 13, 14, 3))
    mask = random.uniform(0.1, 0.9, (2, 13, 14))
    yield "l1", us.l1, [a, b]
    yield "l2", us.l2, [a, b]
    yield "l2 with a mask", us.l2, [a, b, mask]
    yield "l1 with a mask", us.l1, [a, b, mask[..., None]]
    yield "ssim_loss", us.ssim_loss, [a, b]
    yield "ssim_loss, valid", lambda a, b: us.ssim_loss(a, b, valid=True), [a, b]
    yield "mask_iou", us.mask_iou, [mask, 1 - mask**2]
    yield "mask_bce", lambda p: us.mask_bce(p, (1 - mask**2).astype(p.dtype)), [mask]
    inside = (random.uniform(size=(2, 13, 14)) > 0.3).astype(np.float64)
    known = mask + 1, inside
    yield "log_depth", lambda p: us.log_depth(p, *(k.astype(p.dtype) for k in known)), [mask**2 + 1]
    yield "scale_shift_invariant", lambda p: us.scale_shift_invariant(p, *(k.astype(p.dtype) for k in known)), [a[..., 0] + 0.3 * mask]


def drawing_cases():
    vertices, topology, random = shaken(4)
    projected = np.array(us.project(vertices, cameras()).value)
    yield "project", us.project, [vertices, cameras()]
    yield "project, parallel", lambda p, m: us.project(p, m, perspective=False), [vertices, cameras()]
    # Visibility is held fixed: positions move by less than any pixel's centre is from an edge, nearly always.
    colors = random.uniform(size=(len(vertices), 4))
    corners = random.uniform(size=(len(topology.faces), 3, 2))
    yield "interpolate", lambda p, c: us.interpolate(frame_of(p, topology), c), [projected, colors]
    yield "interpolate_corners", lambda p, c: us.interpolate_corners(frame_of(p, topology), c), [projected, corners]
    yield "depth", lambda p: us.depth(frame_of(p, topology), 9.0), [projected]
    yield "soft_silhouette", lambda p: us.soft_silhouette(frame_of(p, topology, sigma_inv=200.0, box_length=0.3)), [projected]
    yield "antialiased_silhouette", lambda p: us.antialiased_silhouette(frame_of(p, topology)), [projected]
    still = frame_of(projected, topology)
    uv = random.uniform(0.05, 0.95, (2, 32, 40, 2))
    image = random.uniform(size=(5, 6, 3))
    rough = frame_of(projected.astype(np.float32), topology)
    yield "texture", lambda uv, image: us.texture(still if uv.dtype == np.float64 else rough, uv, image), [uv, image]


CASES = [*mesh_cases(), *point_cases(), *image_cases(), *drawing_cases()]


def along(function, inputs, cotangent, index, direction, step):
    """The derivative of `(cotangent * value).sum()` along a direction of one input."""

    def value(sign):
        moved = [x + sign * step * direction if i == index else x for i, x in enumerate(inputs)]
        return float(np.sum(cotangent * function(*moved).value))

    return (value(1) - value(-1)) / (2 * step)


@pytest.mark.parametrize("name, function, inputs", CASES, ids=[case[0] for case in CASES])
def test_against_central_differences(name, function, inputs):
    random = np.random.default_rng(7)
    made = function(*inputs)
    cotangent = random.standard_normal(np.shape(made.value))
    gradients = made.backward(cotangent if cotangent.ndim else float(cotangent))
    compared = 0
    for index, (x, gradient) in enumerate(zip(inputs, gradients)):
        assert gradient.shape == x.shape and gradient.dtype == np.float64
        for _ in range(8):
            # Few elements each: a pixel that changes its face spoils one direction, not all.
            direction = random.standard_normal(x.shape) * (random.uniform(size=x.shape) < 4 / x.size)
            expected = along(function, inputs, cotangent, index, direction, STEP)
            finer = along(function, inputs, cotangent, index, direction, STEP / 4)
            if abs(expected - finer) > 1e-5 * (1e-3 + abs(expected)):
                continue  # a kink lies between
            compared += 1
            assert np.sum(gradient * direction) == pytest.approx(expected, rel=2e-5, abs=1e-7), (name, index)
    assert compared >= 5 * len(inputs), "nearly every direction is smooth"


@pytest.mark.parametrize("name, function, inputs", CASES, ids=[case[0] for case in CASES])
def test_single_precision_is_the_same_rounded(name, function, inputs):
    made, rough = function(*inputs), function(*[x.astype(np.float32) for x in inputs])
    cotangent = np.ones(np.shape(made.value))
    # A pixel on an edge may see another face.
    close = np.isclose(made.value, rough.value, rtol=1e-3, atol=1e-4)
    assert np.mean(close) > 0.995
    if not made.inputs or np.ndim(made.value):
        assert rough.value.dtype == np.float32
    for fine, coarse in zip(made.backward(cotangent if cotangent.ndim else 1.0), rough.backward(np.float32(cotangent) if cotangent.ndim else 1.0)):
        assert coarse.dtype == np.float32
        assert np.linalg.norm(fine - coarse) < 0.02 * np.linalg.norm(fine) + 1e-5


def test_cotcurv_holds_its_weights():
    """Its weights count as fixed, so differences are no judge: of a ball of radius r the loss is 1 / (3 r)."""
    ball = us.icosphere(4)
    topology, vertices = ball.topology(), ball.vertices.astype(np.float64)
    value, backward = us.laplacian_cotcurv(vertices, topology)
    assert value == pytest.approx(1 / 3, rel=0.001)
    (gradient,) = backward()
    assert np.abs(gradient.sum(axis=0)).max() < 1e-9


def test_cotangents_hold_their_weights():
    """Beside differences of the definition with the weights of the first positions, and of each mesh in a batch its own."""
    vertices, topology, random = shaken(6)
    weights = plain.cotangents(vertices, topology.faces.astype(np.int64))
    value, backward = us.laplacian_cotangent(vertices, topology)
    (gradient,) = backward()
    for _ in range(8):
        step = STEP * random.standard_normal(vertices.shape)
        ahead, behind = (plain.laplacian_norm(np, vertices + sign * step, weights) for sign in (1, -1))
        assert np.sum(gradient * step) == pytest.approx((ahead - behind) / 2, rel=1e-5, abs=1e-13)
    other = vertices[:, [1, 0, 2]] * [1.0, 2.0, 0.5]
    second = us.laplacian_cotangent(other, topology)
    both = us.laplacian_cotangent(np.stack([vertices, other]), topology)
    assert both.value == pytest.approx((value + second.value) / 2, rel=1e-12)
    assert np.allclose(both.backward()[0], np.stack([gradient, second.backward()[0]]) / 2, rtol=1e-12, atol=1e-15)
    rough = us.laplacian_cotangent(vertices.astype(np.float32), topology)
    assert rough.value == pytest.approx(value, rel=1e-5)
    assert rough.backward()[0].dtype == np.float32 and np.abs(rough.backward()[0] - gradient).max() < 1e-5


def test_only_what_is_wanted():
    a, b = np.ones((2, 3)), np.zeros((2, 3))
    of_a, of_b = us.l2(a, b, wrt="image").backward()
    assert of_a is not None and of_b is None
    assert us.l2(a, b, wrt=()).backward() == (None, None)
    # Points say which normals are compared, and have no gradient.
    made = us.chamfer_normals(a, a, a, a, wrt="y_normals")
    assert made.inputs == ["x_normals", "y_normals"] and made.backward()[0] is None and made.backward()[1].shape == (2, 3)
    with pytest.raises(ValueError, match="wrt names 'x', expected among x_normals, y_normals"):
        us.chamfer_normals(a, a, a, a, wrt="x")
    with pytest.raises(ValueError, match="wrt names 'picture', expected among image, target"):
        us.l2(a, b, wrt=["picture"])


def test_a_result_is_pulled_back_twice_and_unpacks():
    x = np.array([[3.0, 4.0, 0.0]])
    made = us.deformation_norm(x)
    value, backward = made
    assert value == 5.0 and made.inputs == ["offsets"]
    assert np.array_equal(backward()[0], made.backward(1.0)[0])
    assert np.allclose(backward(2.0)[0], [[1.2, 1.6, 0.0]])


def test_inputs_may_change_before_backward():
    x, y = np.full(4, 3.0), np.zeros(4)
    made = us.l2(x, y)
    x[:] = 100.0
    assert np.allclose(made.backward()[0], 1.5)
