"""Lesson 3: a DIB-R texture.

The shape is known, its texture is not. Texture coordinates are interpolated over the image, the texture is looked up there, and what differs from the
images goes back to the texels: those that any view shows are found, the others stay grey.

    python dibr_texture.py dibr_texture.png            # NumPy: gradients are passed back by hand
    python dibr_texture.py dibr_texture.png --torch    # the same through torch.autograd

The picture has the true texture beside the one that was found, and below a view that was not among the images, true and found.
"""

import argparse

import numpy as np

import unsphere as us

SIZE, VIEWS, STEPS = 128, 10, 60
TEXELS = (64, 128)


def globe(rows=24, columns=48):
    """A sphere by latitude and longitude, with texture coordinates [F, 3, 2] of its corners."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    latitude, longitude = np.pi * (v - 0.5), 2 * np.pi * u
    points = np.stack([np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)], -1)
    index = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    uv = np.stack([u, v], -1).reshape(-1, 2)[faces]
    vertices = points.reshape(-1, 3)
    return vertices.astype(np.float32), us.Topology(faces, len(vertices)), uv.astype(np.float32)


def painting():
    """The true texture: rings, a checkerboard and a gradient."""
    height, width = TEXELS
    y, x = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    checks = (np.floor(12 * x) + np.floor(6 * y)) % 2
    rings = 0.5 + 0.5 * np.cos(40 * np.hypot(2 * (x - 0.5), y - 0.5))
    return np.stack([0.2 + 0.6 * checks, 0.2 + 0.7 * rings, 0.3 + 0.6 * x], -1).astype(np.float32)


def matrices(angles, heights):
    eyes = [[3 * np.sin(a) * np.cos(h), 3 * np.sin(h), 3 * np.cos(a) * np.cos(h)] for a, h in zip(angles, heights)]
    return us.matrices([us.Camera.look_at(eye, [0, 0, 0], width=SIZE, height=SIZE) for eye in eyes])


def views():
    """Where the images are taken from: all around, up and down."""
    return matrices(2 * np.pi * np.arange(VIEWS) / VIEWS, [0.7 * (-1) ** i for i in range(VIEWS)])


def seen(vertices, topology, uv, cameras):
    """What is seen, and the texture coordinates there: the same in all steps, as the shape does not move."""
    frame = us.rasterize(us.project(vertices, cameras, wrt=()).value, topology, SIZE, SIZE)
    return frame, us.interpolate_corners(frame, uv, wrt=()).value


def loss_and_gradient(frame, uv, texture, images):
    """The loss, and its gradient by the texels."""
    drawn = us.texture(frame, uv, texture, wrt="image")
    difference = us.l2(drawn.value, images, frame.mask, wrt="image")
    of_drawn = difference.backward()[0]
    return difference.value, drawn.backward(of_drawn)[1]


def fit(steps=STEPS):
    """Finds the texture with NumPy alone: it, and the loss of each step."""
    frame, uv = seen(*globe(), views())
    images = us.texture(frame, uv, painting(), wrt=()).value
    texture = np.full((*TEXELS, 3), 0.5, np.float32)
    adam, losses = us.Adam([texture], rate=0.05), []
    for _ in range(steps):
        loss, gradient = loss_and_gradient(frame, uv, texture, images)
        adam.step([gradient])
        losses.append(loss)
    return texture, losses


def fit_torch(steps=STEPS):
    """The same with PyTorch."""
    import torch

    import unsphere.torch as ut

    frame, uv = seen(*globe(), views())
    images = torch.tensor(us.texture(frame, uv, painting(), wrt=()).value)
    # The shape is fixed: nothing of the frame needs a gradient.
    frame, uv, mask = ut.Frame(torch.zeros(0), frame), torch.tensor(uv), torch.tensor(frame.mask)
    texture = torch.full((*TEXELS, 3), 0.5, requires_grad=True)
    adam, losses = torch.optim.Adam([texture], lr=0.05), []
    for _ in range(steps):
        adam.zero_grad()
        loss = ut.l2(ut.texture(frame, uv, texture), images, mask)
        loss.backward()
        adam.step()
        losses.append(loss.item())
    return texture.detach().numpy(), losses


def new_view(texture):
    """A view that is not among the images, on white."""
    frame, uv = seen(*globe(), matrices([0.9], [0.15]))
    return us.texture(frame, uv, texture, wrt=()).value[0] + 1 - frame.mask[0, :, :, None]


def picture(texture):
    """The true texture and the one found; below, the new view of both. v points up."""
    both = np.concatenate([painting()[::-1], np.clip(texture, 0, 1)[::-1]], axis=1)
    images = np.concatenate([new_view(painting()), new_view(texture)], axis=1)
    return np.clip(np.concatenate([both, images]), 0, 1)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", nargs="?", default="dibr_texture.png", help="the picture to write, a PNG (%(default)s)")
    parser.add_argument("--torch", action="store_true", help="have PyTorch walk backwards")
    told = parser.parse_args(arguments)
    texture, losses = (fit_torch if told.torch else fit)()
    us.write_png(told.output, picture(texture))
    similarity = us.metrics.psnr(new_view(texture), new_view(painting()))
    print(f"loss {losses[0]:.4f} -> {losses[-1]:.6f}; a new view: {similarity:.1f} dB; {told.output}")


if __name__ == "__main__":
    main()
