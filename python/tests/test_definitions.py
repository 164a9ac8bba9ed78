"""Values beside the definitions, written out in NumPy."""

import numpy as np

import plain
import unsphere as us
from scene import BOX, SIGMA, Scene

scene = Scene(np.float64)


def at_pixels(array):
    image, row, column, _ = scene.pixels
    return array[image, row, column]


def close(a, b):
    assert np.allclose(a, b, rtol=1e-9, atol=1e-12)


def test_projection_and_drawing():
    close(us.project(scene.vertices, scene.matrices).value, plain.project(np, scene.vertices, scene.matrices))
    share, depth = plain.weights(np, scene.projected, scene.faces, scene.pixels, scene.centres)
    close(at_pixels(scene.frame.barycentric), share)
    close(at_pixels(us.depth(scene.frame).value), depth)
    drawn = us.interpolate(scene.frame, scene.colors).value
    close(at_pixels(drawn), plain.interpolate(np, scene.projected, scene.faces, scene.pixels, scene.centres, scene.colors))
    assert len(scene.centres) > 100 and not drawn[scene.frame.face < 0].any()


def test_silhouettes():
    soft = us.soft_silhouette(scene.frame).value
    for image in range(2):
        covered = scene.frame.mask[image]
        close(soft[image], plain.soft_silhouette(np, scene.projected[image], scene.faces, scene.grid, covered, SIGMA, BOX))
    assert 0.05 < np.mean((soft > 0.01) & (soft < 0.99))


def test_texture():
    whole = lambda x: x.astype(np.int64)
    found = us.texture(scene.frame, scene.uv, scene.image).value
    close(at_pixels(found), plain.texture(np, at_pixels(scene.uv), scene.image, whole))


def test_losses():
    x, y = scene.points, scene.vertices
    close(us.chamfer(x, y).value, plain.chamfer(np, x, y))
    close(us.mask_iou(scene.masks, scene.masks[::-1]).value, plain.mask_iou(np, scene.masks, scene.masks[::-1]))
    for name in ["l1", "l2"]:
        close(getattr(us, name)(scene.photos, 1 - scene.photos**2).value, getattr(plain, name)(np, scene.photos, 1 - scene.photos**2))
    close(us.edge_length(y, scene.topology, 0.3).value, plain.edge_length(np, y, scene.edges, 0.3))
    close(us.laplacian_norm(y, scene.topology).value, plain.laplacian_norm(np, y, scene.adjacency))
    close(us.normal_consistency(y, scene.topology).value, plain.normal_consistency(np, y, scene.pairs))
    close(us.laplacian_cotangent(y, scene.topology).value, plain.laplacian_norm(np, y, plain.cotangents(y, scene.faces)))
    corner = scene.faces[scene.samples.face]
    share = scene.samples.barycentric.astype(np.float64)
    close(us.surface_points(y, scene.topology, scene.samples).value, plain.surface_points(np, y, corner, share))


def test_neighbors():
    x, y = scene.points, scene.vertices
    for norm in [1, 2]:
        distances = (abs(x[:, None] - y[None]) ** norm).sum(-1)
        near = us.neighbors(x, y, 5, norm=norm)
        assert near.dtype == np.int64 and np.array_equal(near, distances.argsort(1)[:, :5])
        close(us.knn_points(x, y, 5, norm=norm).value, np.sort(distances, 1)[:, :5])
        close(us.knn_points(x, y, 5, norm=norm).value, plain.knn_points(np, x, y, near, norm))
    assert np.array_equal(us.knn_points(x, y, 5).value, us.knn_points(x, y, 5, norm=2).value)
    # A batch is its sets, one by one, and points may have any number of coordinates.
    random = np.random.default_rng(3)
    x, y = random.standard_normal((3, 8, 5)), random.standard_normal((3, 6, 5))
    near, found = us.neighbors(x, y, 6), us.knn_points(x, y, 6).value
    assert near.shape == found.shape == (3, 8, 6)
    for k in range(3):
        assert np.array_equal(near[k], us.neighbors(x[k], y[k], 6))
        close(found[k], us.knn_points(x[k], y[k], 6).value)
    # Of equally near ones the lowest come first.
    assert us.neighbors(np.zeros((1, 2)), np.array([[0, 1], [1, 0], [0, 0], [-1.0, 0]]), 4).tolist() == [[2, 0, 1, 3]]


def test_normals_at_nearest_points():
    x, y = scene.points, scene.vertices
    normals = np.random.default_rng(4).standard_normal((len(x) + len(y), 3))
    m, n = normals[: len(x)], normals[len(x) :]
    there, back = us.neighbors(x, y, 1)[:, 0], us.neighbors(y, x, 1)[:, 0]
    for signed in [False, True]:
        expected = plain.chamfer_normals(np, m, n, there, back, signed)
        close(us.chamfer_normals(x, y, m, n, signed=signed).value, expected)
        # The parts of the two directions add up to it, and of a batch the mean is taken.
        parts = [us.chamfer_normals(x, y, m, n, signed=signed, x_to_y=a, y_to_x=1 - a).value for a in (1, 0)]
        close(sum(parts), expected)
        two = [np.stack([array, array[::-1]]) for array in (x, y, m, n)]
        close(us.chamfer_normals(*two, signed=signed).value, expected)
    assert us.chamfer_normals(x, x, m, -3 * m).value < 1e-12 and abs(us.chamfer_normals(x, x, m, -3 * m, signed=True).value - 4) < 1e-12


def test_pairs_are_those_of_a_closed_mesh():
    assert scene.topology.is_closed and scene.pairs.shape == (len(scene.edges), 4)
