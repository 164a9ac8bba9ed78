"""Surfaces of values on a grid."""

import numpy as np
import pytest

import unsphere as us

BALL = 4 / 3 * np.pi * 0.8**3


def ball(*counts):
    """How far within a ball of radius 0.8 the points of a grid are, [D, H, W], the box being from -1 to 1."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, count) for count in counts), indexing="ij")
    return 0.8 - np.sqrt(x * x + y * y + z * z)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_marching_cubes_of_a_ball(dtype):
    mesh = us.marching_cubes(ball(24, 20, 28).astype(dtype), 0.0)
    assert mesh.is_watertight and mesh.volume == pytest.approx(BALL, rel=0.02)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.8).max() < 0.01
    smaller = us.marching_cubes(ball(24, 20, 28).astype(dtype), 0.3)
    assert smaller.volume == pytest.approx(BALL * (5 / 8) ** 3, rel=0.04)
    assert us.laplacian_norm(mesh.vertices, mesh.topology()).value > 0


def test_marching_cubes_by_hand():
    """One point inside: vertices half-way to its neighbours, of which the last axis is x."""
    values = np.zeros((3, 4, 5))
    values[1, 2, 3] = 1
    mesh = us.marching_cubes(values, 0.5, bounds=((0, 0, 0), (4, 3, 2)))
    around = [[3 + dx / 2, 2 + dy / 2, 1 + dz / 2] for dx, dy, dz in np.vstack([np.eye(3), -np.eye(3)])]
    assert np.array_equal(np.sort(mesh.vertices, axis=0), np.sort(np.array(around, np.float32), axis=0))
    assert mesh.is_watertight and mesh.volume == pytest.approx(4 / 3 * 0.5**3)
    # PyTorch3D's local coordinates: the first point at -1, the last at 1.
    local = us.marching_cubes(values, 0.5).vertices
    assert np.allclose(local, mesh.vertices / [2, 1.5, 1] - 1)
    # Arrays of any strides, and bounds as an array.
    turned = np.asfortranarray(values)
    assert np.array_equal(us.marching_cubes(turned, 0.5, bounds=np.array([[0, 0, 0], [4, 3, 2.0]])).vertices, mesh.vertices)


def test_marching_cubes_ends_where_the_grid_does():
    values = np.ones((4, 4, 4), np.float32)
    values[2:] = 0
    mesh = us.marching_cubes(values, 0.5, bounds=((0, 0, 0), (3, 3, 3)))
    assert np.all(mesh.vertices[:, 2] == 1.5) and not mesh.topology().is_closed
    assert mesh.area == pytest.approx(9)
    assert us.marching_cubes(np.pad(values, 1), 0.5).is_watertight
    for level in (-1, 2):
        assert us.marching_cubes(values, level).vertices.shape == us.marching_cubes(values, level).faces.shape == (0, 3)
    # What is not finite has a side, though no place.
    values[0] = np.inf
    assert np.isfinite(us.marching_cubes(values, 0.5).vertices).all()


def test_cubify_by_hand():
    cells = np.zeros((2, 3, 4))
    cells[1, 2, 3] = cells[1, 2, 2] = 0.7
    mesh = us.cubify(cells, 0.7, bounds=((0, 0, 0), (4, 3, 2)))
    assert mesh.vertices.shape == (12, 3) and mesh.faces.shape == (20, 3)
    assert mesh.vertices.min(0).tolist() == [2, 2, 1] and mesh.vertices.max(0).tolist() == [4, 3, 2]
    assert mesh.is_watertight and mesh.volume == pytest.approx(2) and mesh.area == pytest.approx(10)
    # The box that cells fill is that from -1 to 1.
    whole = us.cubify(np.ones((2, 3, 4), np.float32), 0.5)
    assert whole.vertices.min(0).tolist() == [-1, -1, -1] and whole.vertices.max(0) == pytest.approx([1, 1, 1])
    assert whole.faces.shape == (2 * 2 * (6 + 8 + 12), 3) and whole.volume == pytest.approx(8)


def test_cubify_of_little():
    cells = np.zeros((2, 2, 2))
    assert us.cubify(cells, 0.5).faces.shape == (0, 3)
    assert us.cubify(np.ones((1, 1, 1)), 0.5).volume == pytest.approx(8)
    # Two cells that meet along an edge: closed, but four faces are at that edge.
    cells[0, 0, 0] = cells[0, 1, 1] = 1
    mesh = us.cubify(cells, 0.5)
    assert mesh.faces.shape == (24, 3) and mesh.volume == pytest.approx(2)
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
    assert sorted(set(np.unique(edges, axis=0, return_counts=True)[1])) == [2, 4]
