"""Lesson 1: fit a mesh through a renderer.

Eight small images of a vase, with masks, are all that is known. A grey sphere is drawn from the same cameras; where silhouettes and colours differ, the
renderer says which way each vertex has to move, and Adam moves it. Three small losses keep the surface smooth meanwhile.

    python fit_a_mesh.py fit_a_mesh.png            # NumPy: gradients are passed back by hand
    python fit_a_mesh.py fit_a_mesh.png --torch    # the same through torch.autograd

The picture has four of the views: as they are, the sphere at the beginning, and the mesh in the end.
"""

import argparse

import numpy as np

import unsphere as us

SIZE, VIEWS, STEPS = 96, 8, 200
# How far the soft silhouette reaches, in NDC, and how sharp it is: wide enough that the sphere feels the vase.
SOFT = {"sigma_inv": 2000.0, "box_length": 0.1}
WEIGHTS = {"reach": 0.5, "outline": 10.0, "color": 2.0, "laplacian": 1.0, "normals": 0.1, "edges": 1.0}


def vase():
    """What is to be found: a vase with stripes, as large as a unit sphere."""
    profile = np.array([[0.35, -0.9], [0.6, -0.5], [0.75, -0.1], [0.5, 0.3], [0.25, 0.55], [0.28, 0.75], [0.45, 0.9]], np.float32)
    mesh = us.lathe(profile, 64)
    height, angle = mesh.vertices[:, 1], np.arctan2(mesh.vertices[:, 2], mesh.vertices[:, 0])
    waves = [0.5 + 0.4 * np.sin(5 * height + 3 * angle), 0.5 + 0.3 * height, 0.5 + 0.4 * np.cos(3 * angle)]
    mesh.colors = np.stack(waves, -1).astype(np.float32)
    return mesh


def cameras():
    """A ring of cameras, alternately from above and from below."""
    angles = 2 * np.pi * np.arange(VIEWS) / VIEWS
    eyes = [[3 * np.sin(a), 1.2 * (-1) ** i, 3 * np.cos(a)] for i, a in enumerate(angles)]
    return us.matrices([us.Camera.look_at(eye, [0, 0, 0], width=SIZE, height=SIZE) for eye in eyes])


def draw(vertices, colors, topology, matrices):
    """Masks [N, H, W] and colours [N, H, W, 3], without the way back."""
    frame = us.rasterize(us.project(vertices, matrices, wrt=()).value, topology, SIZE, SIZE)
    return frame.mask, us.interpolate(frame, colors, wrt=()).value


def loss_and_gradients(vertices, colors, topology, matrices, masks, images):
    """The loss, and its gradients by vertices and colours: each function's backward, last one first."""
    points = us.project(vertices, matrices, wrt="points")
    frame = us.rasterize(points.value, topology, SIZE, SIZE, **SOFT)
    # The soft silhouette pulls from afar, but is larger than the mesh; the other one is exact, and pulls within a pixel.
    soft, exact, image = us.soft_silhouette(frame), us.antialiased_silhouette(frame), us.interpolate(frame, colors)
    by_reach = us.mask_iou(soft.value, masks, wrt="prediction")
    by_outline = us.l2(exact.value, masks, wrt="image")
    by_color = us.l2(image.value, images, masks, wrt="image")
    smooth = {
        "laplacian": us.laplacian_norm(vertices, topology),
        "normals": us.normal_consistency(vertices, topology),
        "edges": us.edge_length(vertices, topology),
    }
    loss = WEIGHTS["reach"] * by_reach.value + WEIGHTS["outline"] * by_outline.value + WEIGHTS["color"] * by_color.value
    loss += sum(WEIGHTS[name] * term.value for name, term in smooth.items())

    (from_soft,) = soft.backward(by_reach.backward(WEIGHTS["reach"])[0])
    (from_exact,) = exact.backward(by_outline.backward(WEIGHTS["outline"])[0])
    from_color, of_colors = image.backward(by_color.backward(WEIGHTS["color"])[0])
    of_vertices, _ = points.backward(from_soft + from_exact + from_color)
    for name, term in smooth.items():
        of_vertices += term.backward(WEIGHTS[name])[0]
    return loss, of_vertices, of_colors


def torch_loss(vertices, colors, topology, matrices, masks, images):
    """The same loss of tensors; PyTorch finds the gradients."""
    import unsphere.torch as ut

    frame = ut.rasterize(ut.project(vertices, matrices), topology, SIZE, SIZE, **SOFT)
    return (
        WEIGHTS["reach"] * ut.mask_iou(ut.soft_silhouette(frame), masks)
        + WEIGHTS["outline"] * ut.l2(ut.antialiased_silhouette(frame), masks)
        + WEIGHTS["color"] * ut.l2(ut.interpolate(frame, colors), images, masks)
        + WEIGHTS["laplacian"] * ut.laplacian_norm(vertices, topology)
        + WEIGHTS["normals"] * ut.normal_consistency(vertices, topology)
        + WEIGHTS["edges"] * ut.edge_length(vertices, topology)
    )


def start():
    """A grey sphere."""
    ball = us.icosphere(3)
    return 0.7 * ball.vertices, np.full_like(ball.vertices, 0.5), ball.topology()


def fit(steps=STEPS):
    """Fits with NumPy alone: vertices, colours, topology and the loss of each step."""
    target, matrices = vase(), cameras()
    masks, images = draw(target.vertices, target.colors, target.topology(), matrices)
    vertices, colors, topology = start()
    adam, losses = us.Adam([vertices, colors], rate=0.01), []
    for _ in range(steps):
        loss, *gradients = loss_and_gradients(vertices, colors, topology, matrices, masks, images)
        adam.step(gradients)
        losses.append(loss)
    return vertices, colors, topology, losses


def fit_torch(steps=STEPS):
    """The same with PyTorch."""
    import torch

    target, matrices = vase(), cameras()
    masks, images = draw(target.vertices, target.colors, target.topology(), matrices)
    vertices, colors, topology = start()
    known = [torch.tensor(array) for array in (matrices, masks, images)]
    vertices, colors = (torch.from_numpy(array).requires_grad_() for array in (vertices, colors))
    adam, losses = torch.optim.Adam([vertices, colors], lr=0.01), []
    for _ in range(steps):
        adam.zero_grad()
        loss = torch_loss(vertices, colors, topology, *known)
        loss.backward()
        adam.step()
        losses.append(loss.item())
    return vertices.detach().numpy(), colors.detach().numpy(), topology, losses


def picture(vertices, colors, topology):
    """Rows: the views, the sphere, the mesh; four views each, on white."""
    target, matrices = vase(), cameras()[::2]
    rows = [(target.vertices, target.colors, target.topology()), start(), (vertices, colors, topology)]
    drawn = []
    for row in rows:
        mask, image = draw(*row, matrices)
        drawn.append(np.concatenate(list(image + 1 - mask[..., None]), axis=1))
    return np.clip(np.concatenate(drawn), 0, 1)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", nargs="?", default="fit_a_mesh.png", help="the picture to write, a PNG (%(default)s)")
    parser.add_argument("--torch", action="store_true", help="have PyTorch walk backwards")
    told = parser.parse_args(arguments)
    vertices, colors, topology, losses = fit_torch() if told.torch else fit()
    us.write_png(told.output, picture(vertices, colors, topology))
    print(f"loss {losses[0]:.3f} -> {losses[-1]:.3f} in {len(losses)} steps; {told.output}")


if __name__ == "__main__":
    main()
