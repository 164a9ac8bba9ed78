"""Lesson 2: deform a sphere into a scan.

The scan is a mesh from a file; here one is made and written first, a knobbly shell that no sphere resembles. Points are drawn on both surfaces, the Chamfer
distance says how far they are from each other, and four losses keep the triangles even, the normals smooth, the curvature low.

    python deform_a_sphere.py deform_a_sphere.png            # NumPy: gradients are passed back by hand
    python deform_a_sphere.py deform_a_sphere.png --torch    # the same through torch.autograd

The picture has the scan, the sphere after a twentieth and a fifth of the steps, and in the end, shaded by their normals.
"""

import argparse
import pathlib
import tempfile

import numpy as np

import unsphere as us

STEPS, POINTS, SIZE = 400, 5000, 128
WEIGHTS = {"chamfer": 1.0, "edges": 0.5, "normals": 0.01, "laplacian": 0.1}


def scan(folder):
    """Writes a scan as PLY and reads it again, moved to the origin and scaled into the unit ball."""
    ball = us.icosphere(5)
    x, y, z = ball.vertices.T
    knobs = 1 + 0.18 * np.sin(5 * x + 1) * np.sin(4 * y) + 0.12 * np.cos(6 * z + 2 * x)
    shape = ball.vertices * knobs[:, None] * np.array([1.1, 0.8, 0.95]) + 7.0
    path = pathlib.Path(folder) / "scan.ply"
    us.write_mesh(path, us.Mesh(shape.astype(np.float32), ball.faces))
    mesh = us.read_mesh(path)
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    mesh.vertices = np.ascontiguousarray(centred / np.linalg.norm(centred, axis=1).max())
    return mesh


def loss_and_gradient(vertices, topology, truth, samples):
    """The loss, and its gradient by the vertices."""
    points = us.surface_points(vertices, topology, samples)
    distance = us.chamfer(points.value, truth, wrt="x")
    smooth = {
        "edges": us.edge_length(vertices, topology),
        "normals": us.normal_consistency(vertices, topology),
        "laplacian": us.laplacian_norm(vertices, topology),
    }
    loss = WEIGHTS["chamfer"] * distance.value + sum(WEIGHTS[name] * term.value for name, term in smooth.items())
    of_points, _ = distance.backward(WEIGHTS["chamfer"])
    (of_vertices,) = points.backward(of_points)
    for name, term in smooth.items():
        of_vertices += term.backward(WEIGHTS[name])[0]
    return loss, distance.value, of_vertices


def torch_loss(vertices, topology, truth, samples):
    """The same loss of tensors, and the distance in it."""
    import unsphere.torch as ut

    distance = ut.chamfer(ut.surface_points(vertices, topology, samples), truth)
    loss = (
        WEIGHTS["chamfer"] * distance
        + WEIGHTS["edges"] * ut.edge_length(vertices, topology)
        + WEIGHTS["normals"] * ut.normal_consistency(vertices, topology)
        + WEIGHTS["laplacian"] * ut.laplacian_norm(vertices, topology)
    )
    return loss, distance


def draws(mesh, vertices, topology, step):
    """New points on both surfaces for a step."""
    of_scan = mesh.topology()
    there = us.sample_surface(mesh.vertices, of_scan, POINTS, seed=2 * step)
    here = us.sample_surface(vertices, topology, POINTS, seed=2 * step + 1)
    return us.surface_points(mesh.vertices, of_scan, there, wrt=()).value, here


def deform(mesh, steps=STEPS):
    """Deforms with NumPy alone: the topology, the vertices now and then, and the Chamfer distance of each step."""
    ball = us.icosphere(4)
    vertices, topology = ball.vertices.copy(), ball.topology()
    adam, distances, shapes = us.Adam([vertices], rate=0.005), [], []
    for step in range(steps):
        if step in (steps // 20, steps // 5):
            shapes.append(vertices.copy())
        truth, samples = draws(mesh, vertices, topology, step)
        _, distance, gradient = loss_and_gradient(vertices, topology, truth, samples)
        adam.step([gradient])
        distances.append(distance)
    return topology, [*shapes, vertices], distances


def deform_torch(mesh, steps=STEPS):
    """The same with PyTorch."""
    import torch

    ball = us.icosphere(4)
    vertices, topology = torch.tensor(ball.vertices, requires_grad=True), ball.topology()
    adam, distances, shapes = torch.optim.Adam([vertices], lr=0.005), [], []
    for step in range(steps):
        now = vertices.detach().numpy()
        if step in (steps // 20, steps // 5):
            shapes.append(now.copy())
        truth, samples = draws(mesh, now, topology, step)
        adam.zero_grad()
        loss, distance = torch_loss(vertices, topology, torch.tensor(truth), samples)
        loss.backward()
        adam.step()
        distances.append(distance.item())
    return topology, [*shapes, vertices.detach().numpy()], distances


def shaded(vertices, topology):
    """An image [H, W, 3] of a surface, coloured by its normals."""
    camera = us.Camera.look_at([1.2, 1.0, 2.2], [0, 0, 0], width=SIZE, height=SIZE)
    frame = us.rasterize(us.project(vertices, us.matrices([camera]), wrt=()).value, topology, SIZE, SIZE)
    normals = us.vertex_normals(vertices, topology, wrt=()).value
    return us.interpolate(frame, 0.5 + 0.5 * normals, wrt=()).value[0] + 1 - frame.mask[0, :, :, None]


def picture(mesh, topology, shapes):
    """The scan, then the sphere on its way."""
    images = [shaded(mesh.vertices, mesh.topology()), *(shaded(vertices, topology) for vertices in shapes)]
    return np.clip(np.concatenate(images, axis=1), 0, 1)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", nargs="?", default="deform_a_sphere.png", help="the picture to write, a PNG (%(default)s)")
    parser.add_argument("--torch", action="store_true", help="have PyTorch walk backwards")
    told = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        mesh = scan(folder)
    topology, shapes, distances = (deform_torch if told.torch else deform)(mesh)
    us.write_png(told.output, picture(mesh, topology, shapes))
    found = us.metrics.evaluate(us.Mesh(shapes[-1], topology.faces), mesh)
    score = found["f_scores"][0]
    print(f"Chamfer distance {distances[0]:.5f} -> {distances[-1]:.5f}; F-score {score['f_score']:.3f}; {told.output}")


if __name__ == "__main__":
    main()
