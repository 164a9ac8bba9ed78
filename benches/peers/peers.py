"""Times PyTorch, SciPy, DEODR and Mitsuba on the shapes that the benches of this workspace time.

Prints one JSON object per line: {"id", "peer", "median_ms", "min_ms", "runs", "gflops"}. The id is
that of the criterion bench of the same work; `gflops` counts the arithmetic of the direct algorithm.
Usage: peers.py [--seconds S] [--only PREFIX]
DEODR and Mitsuba are timed where they are installed.
"""

import argparse
import json
import os
import statistics
import time

import numpy as np
import scipy.spatial
import torch
import torch.nn.functional as functional

GEMMS = [(2466, 963, 192), (2562, 1024, 512), (1024, 1024, 1024)]
CONVS = [(8, 56, 64, 64), (8, 28, 128, 128)]  # batch, side, channels in, channels out
CHAMFER = (2466, 9000)
# Products of 512 tokens of width 512, 2048 hidden columns, and attention to 64: three times the forward pass.
ENCODER_FLOPS = 3 * 2 * (512 * 512 * (4 * 512 + 2 * 2048) + 2 * 8 * 64 * 64 * 512)


def timed(work, seconds):
    """Durations of `work`, in seconds: at least seven, after a warm-up."""
    for _ in range(2):
        work()
    durations = []
    start = time.perf_counter()
    while len(durations) < 7 or time.perf_counter() - start < seconds:
        before = time.perf_counter()
        work()
        durations.append(time.perf_counter() - before)
    return durations


def gemms():
    """C = A B with either operand stored transposed; one thread, for the row is per core."""
    torch.set_num_threads(1)
    for m, k, n in GEMMS:
        out = torch.empty(m, n)
        for order in ["nn", "tn", "nt"]:
            a = torch.randn(k, m).T if order == "tn" else torch.randn(m, k)
            b = torch.randn(n, k).T if order == "nt" else torch.randn(k, n)
            work = lambda a=a, b=b, out=out: torch.mm(a, b, out=out)
            yield f"gemm/{m}x{k}x{n}/{order}/1t", "PyTorch", work, 2 * m * k * n


def convs():
    """A 3x3 convolution with padding 1: forward, and gradients of input, weight and bias."""
    torch.set_num_threads(2)
    for batch, side, cin, cout in CONVS:
        flops = 3 * 2 * 9 * batch * side * side * cin * cout
        for layout, name in [
            (torch.contiguous_format, "PyTorch NCHW"),
            (torch.channels_last, "PyTorch channels-last"),
        ]:
            x = torch.randn(batch, cin, side, side).contiguous(memory_format=layout)
            w = torch.randn(cout, cin, 3, 3).contiguous(memory_format=layout)
            g = torch.randn(batch, cout, side, side).contiguous(memory_format=layout)
            b = torch.randn(cout)
            inputs = [t.requires_grad_() for t in (x, w, b)]

            def work(inputs=inputs, g=g):
                y = functional.conv2d(*inputs, padding=1)
                torch.autograd.grad(y, inputs, g)

            yield f"conv2d/{batch}x{side}x{side}x{cin}-{cout}/forward-backward/2t", name, work, flops


def chamfers():
    """Mean squared distance to the nearest point and 1 - |cos| of the normals there, both ways."""
    torch.set_num_threads(2)
    p, q = CHAMFER
    rng = np.random.default_rng(0)
    sphere = lambda n: (lambda v: v / np.linalg.norm(v, axis=1, keepdims=True))(
        rng.standard_normal((n, 3))
    ).astype(np.float32)
    a, b = sphere(p), sphere(q)
    x = torch.tensor(a, requires_grad=True)
    nx = torch.tensor(a.copy(), requires_grad=True)
    y, ny = torch.tensor(b), torch.tensor(b.copy())

    def one_way(x, nx, y, ny, nearest):
        distance = (x - y[nearest]).square().sum(1).mean()
        cosine = functional.cosine_similarity(nx, ny[nearest], dim=1, eps=1e-6)
        return distance + (1 - cosine.abs()).mean()

    def work():
        with torch.no_grad():
            d = torch.cdist(x, y)
            to_y, to_x = d.argmin(1), d.argmin(0)
        loss = one_way(x, nx, y, ny, to_y) + one_way(y, ny, x, nx, to_x)
        torch.autograd.grad(loss, [x, nx])

    def tree():
        scipy.spatial.cKDTree(b).query(a, workers=2)
        scipy.spatial.cKDTree(a).query(b, workers=2)

    yield f"chamfer/{p}x{q}/forward-backward/2t", "PyTorch cdist", work, None
    yield f"chamfer/{p}x{q}/nearest/2t", "SciPy KD-tree", tree, None


def nets():
    """A transformer's encoder layer, and a graph convolution with all its gradients."""
    torch.set_num_threads(2)
    layer = torch.nn.TransformerEncoderLayer(512, 8, 2048, batch_first=True)
    tokens = torch.randn(8, 64, 512, requires_grad=True)
    inputs = [tokens, *layer.parameters()]

    def encode():
        torch.autograd.grad(layer(tokens).sum(), inputs)

    yield "nets/encoder-layer/8x64x512/forward-backward/2t", "PyTorch", encode, ENCODER_FLOPS

    # As many entries in each row as an icosphere's vertices have neighbours.
    vertices, width, out = 2562, 963, 192
    rows = torch.arange(vertices).repeat_interleave(6)
    columns = (rows + torch.tensor([1, 2, 40, 2522, 2560, 2561]).repeat(vertices)) % vertices
    graph = torch.sparse_coo_tensor(
        torch.stack([rows, columns]), torch.ones(6 * vertices), (vertices, vertices)
    ).to_sparse_csr()
    own, across = torch.nn.Linear(width, out), torch.nn.Linear(width, out)
    x = torch.randn(vertices, width, requires_grad=True)
    weights = [x, *own.parameters(), *across.parameters()]

    def convolve():
        y = own(x) + graph @ across(x)
        torch.autograd.grad(y, weights, y.detach())

    flops = 3 * 2 * 2 * vertices * width * out
    yield f"nets/graph-conv/{vertices}/{width}-{out}/forward-backward/2t", "PyTorch", convolve, flops


def features():
    """VGG16 up to its fifth pooling, and ResNet-18 in training: forward, and gradients of all weights."""
    torch.set_num_threads(2)
    networks = [
        ("vgg16-features", vgg16, (4, 224)),
        ("vgg16-features", vgg16, (16, 64)),
        ("resnet18", resnet18, (4, 256)),
    ]
    for name, build, (batch, side) in networks:
        for layout, peer in [
            (torch.contiguous_format, "PyTorch NCHW"),
            (torch.channels_last, "PyTorch channels-last"),
        ]:
            net = build().to(memory_format=layout)
            images = torch.randn(batch, 3, side, side).contiguous(memory_format=layout)
            weights = list(net.parameters())

            def work(net=net, images=images, weights=weights):
                torch.autograd.grad(net(images).sum(), weights)

            yield f"nets/{name}/{batch}x{side}x{side}/forward-backward/2t", peer, work, None


def vgg16():
    layers, channels = [], 3
    for width, count in [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)]:
        for _ in range(count):
            layers += [torch.nn.Conv2d(channels, width, 3, padding=1), torch.nn.ReLU(inplace=True)]
            channels = width
        layers.append(torch.nn.MaxPool2d(2))
    return torch.nn.Sequential(*layers)


class Residual(torch.nn.Module):
    """Two convolutions beside a way round them, which is a convolution where the shape changes."""

    def __init__(self, channels, width, stride):
        super().__init__()
        conv = lambda a, b, side, step: [
            torch.nn.Conv2d(a, b, side, step, side // 2, bias=False),
            torch.nn.BatchNorm2d(b),
        ]
        relu = torch.nn.ReLU(inplace=True)
        self.own = torch.nn.Sequential(
            *conv(channels, width, 3, stride), relu, *conv(width, width, 3, 1)
        )
        changes = stride != 1 or channels != width
        self.round = torch.nn.Sequential(*(conv(channels, width, 1, stride) if changes else []))

    def forward(self, x):
        return torch.relu(self.own(x) + self.round(x))


def resnet18():
    layers = [
        torch.nn.Conv2d(3, 64, 7, 2, 3, bias=False),
        torch.nn.BatchNorm2d(64),
        torch.nn.ReLU(inplace=True),
        torch.nn.MaxPool2d(3, 2, 1),
    ]
    channels = 64
    for width, stride in [(64, 1), (128, 2), (256, 2), (512, 2)]:
        layers += [Residual(channels, width, stride), Residual(width, width, 1)]
        channels = width
    return torch.nn.Sequential(*layers)


SCENES = [(4, 256), (5, 512)]  # level of the icosphere, side of the image
DISTANCE, FOCAL = 4.0, 3.4


def icosphere(level):
    """Vertices and faces of a subdivided icosahedron on the unit sphere."""
    g = (1 + 5**0.5) / 2
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    points += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    faces += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    faces += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    points = [np.array(p) / np.linalg.norm(p) for p in points]
    for _ in range(level):
        middles, finer = {}, []

        def middle(a, b):
            key = (min(a, b), max(a, b))
            if key not in middles:
                p = points[a] + points[b]
                middles[key] = len(points)
                points.append(p / np.linalg.norm(p))
            return middles[key]

        for a, b, c in faces:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = finer
    return np.array(points), np.array(faces)


def deodr_scenes():
    """DEODR: vertex colours and the mask as a fourth channel, edges antialiased, one thread, double precision."""
    try:
        import trimesh
        import builtins

        builtins.Trimesh = trimesh.Trimesh  # the release names it without importing it
        import deodr
    except ImportError:
        return
    from deodr.differentiable_renderer import PerspectiveCamera, Scene3D
    from deodr.triangulated_mesh import ColoredTriMesh

    for level, side in SCENES:
        points, faces = icosphere(level)
        colors = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        # The camera looks along +z with y down; where it stands is the translation it is given.
        camera = PerspectiveCamera(
            side, side, 2 * np.degrees(np.arctan(1 / FOCAL)), np.array([0.0, 0.0, -DISTANCE])
        )
        mesh = ColoredTriMesh(faces, points, clockwise=False, colors=colors)
        scene = Scene3D(sigma=1)
        scene.set_light(None, 1.0)
        scene.set_mesh(mesh)
        scene.set_background_color(np.zeros(4))
        gradient = np.full((side, side, 4), 0.01)
        seen = scene.render(camera)[..., 3].mean()
        assert 0.5 < seen < 0.7, f"DEODR: the sphere covers {seen} of the image"

        def work(scene=scene, mesh=mesh, camera=camera, gradient=gradient, points=points):
            mesh.set_vertices(points)
            scene.render(camera)
            scene.render_backward(gradient.copy())

        yield f"raster/forward-backward/icosphere-{level}-{side}-batch-1", "DEODR 0.2.3, one thread", work, None


def mitsuba_scenes():
    """Mitsuba 3: direct light, silhouettes by projective sampling, one sample a pixel, after compilation."""
    try:
        import drjit
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
        drjit.set_thread_count(2)
    except (ImportError, RuntimeError):
        return
    for level, side in SCENES:
        points, faces = icosphere(level)
        mesh = mitsuba.Mesh("ball", len(points), len(faces))
        own = mitsuba.traverse(mesh)
        own["vertex_positions"] = points.astype(np.float32).ravel()
        own["faces"] = faces.astype(np.uint32).ravel()
        own.update()
        scene = mitsuba.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "direct_projective"},
                "light": {"type": "constant"},
                "camera": {
                    "type": "perspective",
                    "fov": float(2 * np.degrees(np.arctan(1 / FOCAL))),
                    "to_world": mitsuba.ScalarTransform4f().look_at(
                        origin=[0, 0, DISTANCE], target=[0, 0, 0], up=[0, 1, 0]
                    ),
                    "film": {"type": "hdrfilm", "width": side, "height": side},
                },
                "ball": mesh,
            }
        )
        params = mitsuba.traverse(scene)
        key = next(k for k in params.keys() if k.endswith("vertex_positions"))

        def work(scene=scene, params=params, key=key):
            drjit.enable_grad(params[key])
            image = mitsuba.render(scene, params, spp=1)
            drjit.backward(drjit.mean(image))
            drjit.eval(drjit.grad(params[key]))
            drjit.sync_thread()

        yield f"raster/forward-backward/icosphere-{level}-{side}-batch-1", f"Mitsuba {mitsuba.__version__} LLVM", work, None


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="time per case")
    parser.add_argument("--only", default="", help="ids that begin with this")
    parser.add_argument("--label", default="", help="put behind each peer's name")
    options = parser.parse_args()
    torch.manual_seed(0)
    version = {
        "torch": torch.__version__,
        "scipy": scipy.__version__,
        "numpy": np.__version__,
        "capability": torch.backends.cpu.get_cpu_capability(),
        "cores": os.cpu_count(),
    }
    print(json.dumps({"versions": version}), flush=True)
    for family in [gemms, convs, chamfers, nets, features, deodr_scenes, mitsuba_scenes]:
        for name, peer, work, flops in family():
            if not name.startswith(options.only):
                continue
            durations = timed(work, options.seconds)
            median, least = statistics.median(durations), min(durations)
            row = {
                "id": name,
                "peer": peer + options.label,
                "median_ms": median * 1e3,
                "min_ms": least * 1e3,
                "runs": len(durations),
            }
            if flops:
                row["gflops"] = flops / median / 1e9
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
