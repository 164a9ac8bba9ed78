"""What goes in and what comes out: memory, kinds of arrays, mistakes."""

import gc
import threading
import time

import numpy as np
import pytest

import unsphere as us


def frame(dtype=np.float32):
    ball = us.icosphere(2)
    camera = us.Camera.look_at([0, 0, 3], [0, 0, 0], width=24, height=16)
    projected = us.project(ball.vertices.astype(dtype), us.matrices([camera], np.dtype(dtype).name)).value
    return us.rasterize(projected, ball.topology(), 16, 24)


def test_values_share_their_memory_and_outlive_what_made_them():
    made = us.soft_silhouette(frame())
    value = made.value
    assert value is made.value and not value.flags.owndata and not value.flags.writeable
    before = value.copy()
    del made
    gc.collect()
    for _ in range(20):
        us.soft_silhouette(frame())  # would write over it, if its memory were free
    assert np.array_equal(before, value)
    with pytest.raises(ValueError, match="read-only"):
        value[0, 0, 0] = 2.0


def test_gradients_are_the_callers_own():
    (gradient,) = us.soft_silhouette(frame()).backward(np.ones((1, 16, 24), np.float32))
    assert gradient.flags.writeable
    gradient *= 2


def test_arrays_of_any_strides():
    x = np.random.default_rng(0).standard_normal((5, 7, 3))
    for other in (x[::2], x[:, ::-1], np.asfortranarray(x), x.transpose(1, 0, 2)):
        own = np.ascontiguousarray(other)
        target = np.arange(own.size).reshape(own.shape) / 10
        a, b = us.l2(other, target), us.l2(own, target)
        assert a.value == b.value and np.array_equal(a.backward()[0], b.backward()[0])
        assert np.allclose(a.backward()[0], 2 * (own - target) / own.size)
    records = np.zeros(6, [("xyz", "<f4", 3), ("rgb", "u1", 3), ("face", "<u4", 3)])
    records["xyz"], records["face"] = np.random.default_rng(1).standard_normal((6, 3)), [0, 1, 2]
    assert us.l1(records["xyz"], np.ascontiguousarray(records["xyz"])).value == 0
    assert np.array_equal(us.Topology(records["face"], 6).faces, np.tile(np.arange(3), (6, 1)))
    image = us.depth(frame())
    turned = np.asfortranarray(np.ones((1, 16, 24), np.float32))
    assert np.array_equal(image.backward(turned)[0], image.backward(np.ones((1, 16, 24), np.float32))[0])


def test_faces_of_any_integers():
    faces = us.icosphere(1).faces
    for kind in (np.int32, np.int64, np.uint32, np.uint8, np.int16, np.uint64):
        assert np.array_equal(us.Topology(faces.astype(kind), 42).faces, faces)
    with pytest.raises(ValueError, match="face 0 names vertex"):
        us.Topology(faces, 12)
    with pytest.raises(ValueError, match="-1 is no index"):
        us.Topology(np.array([[0, 1, -1]]), 3)
    with pytest.raises(ValueError, match=r"\[n, 3\] expected, found \[2, 4\]"):
        us.Topology(np.zeros((2, 4), np.int64), 3)
    with pytest.raises(TypeError, match="integers expected, found an array of float64"):
        us.Topology(np.zeros((2, 3)), 3)


def test_what_is_seen():
    seen = frame()
    assert seen.shape == (1, 16, 24) or list(seen.shape) == [1, 16, 24]
    inside = seen.face >= 0
    assert np.array_equal(inside, seen.mask == 1) and np.array_equal(inside, np.isfinite(seen.depth))
    assert np.allclose(seen.barycentric.sum(-1), inside, atol=1e-6)
    assert np.array_equal(us.depth(seen, 0.5).value, np.where(inside, seen.depth, np.float32(0.5)))


ball = us.icosphere(1)
topology = ball.topology()
V = ball.vertices
SEEN = frame()
EMPTY, ONES, NANS = np.ones((0, 3)), np.ones((4, 3)), np.full((4, 3), np.nan)
CELLS, HUGE = np.ones((3, 4, 5)), np.broadcast_to(np.float32(1), (2**12,) * 3)
MISTAKES = {
    "l2": lambda: us.l2(np.ones(3), np.ones(4)),
    "l2 mask": lambda: us.l2(np.ones((2, 3)), np.ones((2, 3)), np.ones(5)),
    "ssim axes": lambda: us.ssim_loss(np.ones((3, 3)), np.ones((3, 3))),
    "ssim size": lambda: us.ssim_loss(np.ones((1, 8, 8, 1)), np.ones((1, 8, 8, 1)), valid=True),
    "mask_iou scalar": lambda: us.mask_iou(np.ones(()), np.ones(())),
    "chamfer empty": lambda: us.chamfer(np.ones((0, 3)), np.ones((4, 3))),
    "chamfer batch": lambda: us.chamfer(np.ones((2, 4, 3)), np.ones((3, 4, 3))),
    "chamfer ranks": lambda: us.chamfer(np.ones((4, 3)), np.ones((1, 4, 3))),
    "chamfer axes": lambda: us.chamfer(np.ones((4, 2)), np.ones((4, 2))),
    "earth mover": lambda: us.earth_mover(np.ones((4, 3)), np.ones((5, 3))),
    "earth mover nan": lambda: us.earth_mover(np.full((4, 3), np.nan), np.ones((4, 3))),
    "knn none": lambda: us.knn_points(ONES, ONES, 0),
    "knn less than none": lambda: us.knn_points(ONES, ONES, -1),
    "knn too many": lambda: us.knn_points(ONES, ONES, 5),
    "knn norm": lambda: us.knn_points(ONES, ONES, 1, norm=3),
    "knn empty": lambda: us.knn_points(EMPTY, ONES, 1),
    "knn among none": lambda: us.knn_points(ONES, EMPTY, 1),
    "knn flat": lambda: us.knn_points(np.ones((4, 0)), np.ones((4, 0)), 1),
    "knn batch": lambda: us.knn_points(np.ones((2, 4, 3)), np.ones((3, 4, 3)), 1),
    "knn ranks": lambda: us.knn_points(ONES, ONES[None], 1),
    "knn axes": lambda: us.knn_points(ONES, np.ones((4, 2)), 1),
    "knn one point": lambda: us.knn_points(np.ones(3), ONES, 1),
    "knn nan": lambda: us.knn_points(NANS, ONES, 1),
    "knn among nan": lambda: us.knn_points(ONES, NANS, 1),
    "knn huge": lambda: us.knn_points(np.broadcast_to(np.float64(1), (2**30, 3)), ONES, 3),
    "neighbors none": lambda: us.neighbors(ONES, ONES, 0),
    "neighbors too many": lambda: us.neighbors(ONES, ONES, 2**40),
    "neighbors nan": lambda: us.neighbors(ONES, NANS, 1),
    "neighbors norm": lambda: us.neighbors(ONES, ONES, 1, norm=0),
    "normals missing": lambda: us.chamfer_normals(ONES, ONES, ONES[:3], ONES),
    "normals flat": lambda: us.chamfer_normals(ONES, ONES, ONES, ONES[:, :2]),
    "normals empty": lambda: us.chamfer_normals(EMPTY, ONES, EMPTY, ONES),
    "normals batch": lambda: us.chamfer_normals(ONES, ONES, ONES[None], ONES),
    "normals nan": lambda: us.chamfer_normals(ONES, ONES, ONES, NANS),
    "normals of nan": lambda: us.chamfer_normals(NANS, ONES, ONES, ONES),
    "cotangent": lambda: us.laplacian_cotangent(V[:-1], topology),
    "cotangent axes": lambda: us.laplacian_cotangent(V[:, :2].copy(), topology),
    "cotangent ranks": lambda: us.laplacian_cotangent(V[None, None], topology),
    "cotangent nan": lambda: us.laplacian_cotangent(np.full_like(V, np.nan), topology),
    "cotangent infinite": lambda: us.laplacian_cotangent(np.full_like(V, np.inf), topology),
    "cubes axes": lambda: us.marching_cubes(ONES, 0.5),
    "cubes empty": lambda: us.marching_cubes(CELLS[:0], 0.5),
    "cubes flat": lambda: us.marching_cubes(CELLS[:1], 0.5),
    "cubes nan": lambda: us.marching_cubes(np.full((3, 4, 5), np.nan), 0.5),
    "cubes level": lambda: us.marching_cubes(CELLS, np.nan),
    "cubes no level": lambda: us.marching_cubes(CELLS, 1e300),
    "cubes huge": lambda: us.marching_cubes(HUGE, 0.5),
    "cubes upside down": lambda: us.marching_cubes(CELLS, 0.5, bounds=((1, 1, 1), (0, 0, 0))),
    "cubes bounds": lambda: us.marching_cubes(CELLS, 0.5, bounds=np.ones((2, 2))),
    "cubify axes": lambda: us.cubify(CELLS[None], 0.5),
    "cubify empty": lambda: us.cubify(CELLS[:, :0], 0.5),
    "cubify nan": lambda: us.cubify(np.full((3, 4, 5), np.nan), 0.5),
    "cubify threshold": lambda: us.cubify(CELLS, float("inf")),
    "cubify huge": lambda: us.cubify(HUGE, 0.5),
    "cubify flat box": lambda: us.cubify(CELLS, 0.5, bounds=((0, 0, 0), (1, 0, 1))),
    "cubify endless box": lambda: us.cubify(CELLS, 0.5, bounds=((-3e38,) * 3, (3e38,) * 3)),
    "laplacian": lambda: us.laplacian_norm(V[:-1], topology),
    "edge axes": lambda: us.edge_length(V[:, :2].copy(), topology),
    "surface": lambda: us.surface_points(V, topology, us.sample_surface(us.icosphere(2).vertices, us.icosphere(2).topology(), 99)),
    "point face": lambda: us.point_face_distance(np.ones((0, 3)), V.astype(float), topology),
    "depths": lambda: us.log_depth(np.ones((3, 3)), np.ones((3, 3)), np.ones((3, 3))),
    "scales": lambda: us.scale_shift_invariant(*np.ones((3, 1, 4, 4)), scales=40),
    "project": lambda: us.project(V, np.ones((1, 4, 4), np.float32)),
    "rasterize": lambda: us.rasterize(np.ones((1, 7, 3), np.float32), topology, 8, 8),
    "rasterize nan": lambda: us.rasterize(np.where(np.arange(3) == 1, np.nan, V)[None].astype(V.dtype), topology, 8, 8),
    "rasterize huge": lambda: us.rasterize(V[None], topology, 2**40, 2**40),
    "rasterize sigma": lambda: us.rasterize(V[None], topology, 8, 8, sigma_inv=-1),
    "interpolate": lambda: us.interpolate(SEEN, np.ones((5, 3), np.float32)),
    "interpolate batch": lambda: us.interpolate(SEEN, np.ones((3, 162, 3), np.float32)),
    "corners": lambda: us.interpolate_corners(SEEN, np.ones((5, 3, 2), np.float32)),
    "texture": lambda: us.texture(SEEN, np.ones((1, 16, 24, 3), np.float32), np.ones((4, 4, 3), np.float32)),
    "texture empty": lambda: us.texture(SEEN, np.ones((1, 16, 24, 2), np.float32), np.ones((0, 4, 3), np.float32)),
    "cotangent shape": lambda: us.depth(SEEN).backward(np.ones((16, 24), np.float32)),
    "no cotangent": lambda: us.depth(SEEN).backward(),
    "metrics": lambda: us.metrics.psnr(np.ones((4, 4)), np.ones((4, 5))),
    "metrics iou": lambda: us.metrics.iou(np.ones(4), np.ones(4)),
    "metrics points": lambda: us.metrics.point_distances(np.ones((0, 3)), np.ones((4, 3))),
    "protocol": lambda: us.metrics.evaluate(ball, ball, "emd"),
    "camera": lambda: us.Camera.look_at([0, 0, float("nan")], [0, 0, 0], width=8, height=8),
    "mesh index": lambda: us.Mesh(np.zeros((3, 3)), np.array([[0, 1, 3]])),
    "mesh nan": lambda: us.Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]])),
    "mesh uv": lambda: us.Mesh(V, ball.faces, uv=np.zeros((3, 2), np.float32)),
    "mask_iou bytes": lambda: us.mask_iou(np.ones((1, 4, 4)), np.full((1, 4, 4), 255.0)),
    "mask_iou negative": lambda: us.mask_iou(np.full((1, 4, 4), -0.1), np.ones((1, 4, 4))),
    "mask_iou nan": lambda: us.mask_iou(np.full((1, 4, 4), np.nan), np.ones((1, 4, 4))),
    "mask_bce bytes": lambda: us.mask_bce(np.ones((1, 4, 4)), np.full((1, 4, 4), 255.0)),
    "degrees": lambda: us.Camera.look_at([0, 0, 3], [0, 0, 0], fov_y=45, width=8, height=8),
    "no angle": lambda: us.Camera.look_at([0, 0, 3], [0, 0, 0], fov_y=0, width=8, height=8),
    "samples": lambda: us.sample_surface(np.zeros_like(V), topology, 5),
    "level": lambda: us.icosphere(30),
    "torus": lambda: us.torus(rings=2),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_value_errors(name, capfd):
    with pytest.raises(ValueError) as caught:
        MISTAKES[name]()
    assert len(str(caught.value)) > 15
    assert "panicked" not in capfd.readouterr().err, "checked before the library had to refuse it"


def test_types_are_told():
    with pytest.raises(TypeError, match="found an array of int64"):
        us.l2(np.ones(3, np.int64), np.ones(3))
    with pytest.raises(TypeError, match="found a list"):
        us.l2([1.0], np.ones(1))
    with pytest.raises(TypeError, match="l2: target: an array of float32 expected as the others are, found float64"):
        us.l2(np.ones(3, np.float32), np.ones(3))
    with pytest.raises(TypeError, match="a cotangent of float32 expected, found float64"):
        us.depth(SEEN).backward(np.ones((1, 16, 24)))
    with pytest.raises(TypeError, match="found an array of bool"):
        us.cubify(CELLS > 0, 0.5)
    with pytest.raises(TypeError, match="bounds"):
        us.marching_cubes(CELLS, 0.5, bounds=(-1, 1))
    for k in (1.0, "1", None):
        with pytest.raises(TypeError):
            us.knn_points(ONES, ONES, k)
    with pytest.raises(TypeError, match="knn_points: y: an array of float64 expected as the others are, found float32"):
        us.knn_points(ONES, ONES.astype(np.float32), 1)
    with pytest.raises(TypeError, match="neighbors: y: an array of float64 expected as the others are, found float32"):
        us.neighbors(ONES, ONES.astype(np.float32), 1)
    with pytest.raises(TypeError, match="chamfer_normals: x: an array of float32 expected as the others are, found float64"):
        us.chamfer_normals(ONES, ONES, *np.ones((2, 4, 3), np.float32))
    with pytest.raises(TypeError, match="topology: mesh.topology"):
        us.laplacian_cotangent(V, ball)
    with pytest.raises(TypeError, match="topology: mesh.topology.. or Topology.faces, number_of_vertices. expected, found an array of uint32"):
        us.laplacian_norm(V, ball.faces)
    with pytest.raises(TypeError, match="topology: mesh.topology.. or .* found a unsphere.Mesh"):
        us.rasterize(V[None], ball, 8, 8)


def test_what_does_not_fit_is_told():
    with pytest.raises(ValueError, match="mask_iou: target: values in .0, 1. expected, found 255"):
        us.mask_iou(np.ones((1, 4, 4), np.float32), np.full((1, 4, 4), 255, np.float32))
    beside = np.full((1, 4, 4), 1 + 1e-7)  # what rounding adds
    assert us.mask_iou(beside, np.ones((1, 4, 4))).value == pytest.approx(0, abs=1e-6)
    with pytest.raises(ValueError, match="radians above 0 and below pi expected, found 45"):
        us.Camera.look_at([0, 0, 3], [0, 0, 0], fov_y=45, width=8, height=8)
    matrices = us.matrices([us.Camera.look_at([0, 0, 3], [0, 0, 0], width=8, height=8)])
    turned = {
        "project: points": lambda: us.project(np.ones((3, 42), np.float32), matrices),
        "rasterize: projected": lambda: us.rasterize(np.ones((1, 3, 42), np.float32), topology, 8, 8),
        "laplacian_norm: positions": lambda: us.laplacian_norm(np.ones((3, 42)), topology),
        "chamfer: y": lambda: us.chamfer(np.ones((4, 3)), np.ones((3, 42))),
        "point_face_distance: x": lambda: us.point_face_distance(np.ones((3, 42)), V.astype(float), topology),
    }
    for name, call in turned.items():
        with pytest.raises(ValueError, match=f"{name} has 42 in its last axis, expected 3"):
            call()


def test_other_threads_run_meanwhile():
    random = np.random.default_rng(0)
    x, y = random.standard_normal((2, 20_000, 3)).astype(np.float32)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(1e-4)

    ticking = threading.Thread(target=tick)
    ticking.start()
    start = time.perf_counter()
    while len(ticks) < 3 or time.perf_counter() - start < 0.2:
        us.chamfer(x, y)
    done.set()
    ticking.join()
    assert len(ticks) > 20, "the interpreter was held"


def test_threads_may_share_a_result():
    seen = frame()
    made = us.soft_silhouette(seen)
    one = np.ones((1, 16, 24), np.float32)
    expected = made.backward(one)[0]
    found = [None] * 8

    def pull(i):
        for _ in range(20):
            found[i] = made.backward(one)[0]
            us.depth(seen).backward(one)

    threads = [threading.Thread(target=pull, args=(i,)) for i in range(8)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert all(np.array_equal(expected, gradient) for gradient in found)


def test_counts_below_zero_are_wrong_values():
    for wrong in (
        lambda: us.icosphere(-1),
        lambda: us.torus(rings=-1),
        lambda: us.Topology(np.zeros((0, 3), np.uint32), -1),
        lambda: us.sample_surface(us.icosphere(1).vertices, us.icosphere(1).topology(), 2**40),
        lambda: us.cuboid([-1, 1, 1]),
        lambda: us.odeint(lambda t, y: y, np.zeros(1), (0.0, 1.0), step=0.1, max_steps=-1),
    ):
        with pytest.raises(ValueError):
            wrong()
    with pytest.raises(ValueError, match="too large"):
        us.icosphere(2**33)
    mesh = us.icosphere(1)
    mesh.vertices = np.zeros(())
    with pytest.raises(ValueError, match=r"\[V, 3\]"):
        mesh.topology()
