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
    corner = scene.faces[scene.samples.face]
    share = scene.samples.barycentric.astype(np.float64)
    close(us.surface_points(y, scene.topology, scene.samples).value, plain.surface_points(np, y, corner, share))


def test_pairs_are_those_of_a_closed_mesh():
    assert scene.topology.is_closed and scene.pairs.shape == (len(scene.edges), 4)
