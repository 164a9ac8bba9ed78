"""Times PyTorch and SciPy on the shapes that the benches of this workspace time.

Prints one JSON object per line: {"id", "peer", "median_ms", "min_ms", "runs", "gflops"}. The id is
that of the criterion bench of the same work; `gflops` counts the arithmetic of the direct algorithm.
Usage: peers.py [--seconds S] [--only PREFIX]
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
    for family in [gemms, convs, chamfers, nets]:
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
