"""The functions once more, as their definitions read, of operations that NumPy and PyTorch both have.

`xp` is either module; arrays of indices are of its kind. On NumPy they check values, on PyTorch gradients too.
"""


def project(xp, points, matrices):
    """[V, 3] and [N, 3, 4] to [N, V, 3]."""
    seen = (matrices[:, None, :, :3] * points[None, :, None, :]).sum(-1) + matrices[:, None, :, 3]
    depth = seen[..., 2:3]
    return xp.concatenate([seen[..., :2] / depth, depth], -1)


def corners(projected, faces, pixels):
    """The corners of the faces that are seen, [K, 3, 3], at pixels as (image, row, column, face)."""
    image, _, _, face = pixels
    return projected[image[:, None], faces[face]]


def weights(xp, projected, faces, pixels, centres):
    """Perspective-correct barycentric coordinates [K, 3] at pixels, and the depth [K] there."""
    abc = corners(projected, faces, pixels)
    x, y, z = abc[..., 0], abc[..., 1], abc[..., 2]
    px, py = centres[:, 0:1], centres[:, 1:2]
    areas = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        areas.append((x[:, i] - px[:, 0]) * (y[:, j] - py[:, 0]) - (x[:, j] - px[:, 0]) * (y[:, i] - py[:, 0]))
    screen = xp.stack(areas, -1)
    over_depth = screen / screen.sum(-1)[:, None] / z
    depth = 1 / over_depth.sum(-1)
    return over_depth * depth[:, None], depth


def interpolate(xp, projected, faces, pixels, centres, attributes):
    """Attributes [V, C] at pixels, [K, C]."""
    share, _ = weights(xp, projected, faces, pixels, centres)
    return (share[:, :, None] * attributes[faces[pixels[3]]]).sum(1)


def soft_silhouette(xp, projected, faces, centres, covered, sigma_inv, box_length):
    """Of one image: projected [V, 3], centres [H, W, 2], covered [H, W] as 0 and 1."""
    abc = projected[faces][:, None, None, :, :2]
    p = centres[None]
    distances = []
    for k in range(3):
        a, b = abc[..., k, :], abc[..., (k + 1) % 3, :]
        along = xp.clip(((p - a) * (b - a)).sum(-1) / ((b - a) * (b - a)).sum(-1), 0, 1)
        off = a + along[..., None] * (b - a) - p
        distances.append((off * off).sum(-1))
    near = xp.amin(xp.stack(distances, -1), -1)
    low, high = xp.amin(abc, -2) - box_length, xp.amax(abc, -2) + box_length
    inside = ((p >= low) & (p < high)).all(-1)
    missed = xp.where(inside, 1 - xp.exp(-sigma_inv * near), near * 0 + 1)
    return covered + (1 - covered) * (1 - missed.prod(0))


def texture(xp, uv, image, index):
    """Bilinear lookup at uv [K, 2] in [Ht, Wt, C]; index makes whole numbers to indices."""
    height, width = image.shape[0], image.shape[1]
    column = xp.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    row = xp.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    left, top = index(xp.clip(xp.floor(column), 0, width - 2)), index(xp.clip(xp.floor(row), 0, height - 2))
    s, t = (column - left)[:, None], (row - top)[:, None]
    upper = (1 - s) * image[top, left] + s * image[top, left + 1]
    lower = (1 - s) * image[top + 1, left] + s * image[top + 1, left + 1]
    return (1 - t) * upper + t * lower


def chamfer(xp, x, y):
    """[P, 3] and [Q, 3]."""
    squares = ((x[:, None] - y[None]) ** 2).sum(-1)
    return xp.amin(squares, 1).mean() + xp.amin(squares, 0).mean()


def knn_points(xp, x, y, near, norm):
    """[P, D] and [Q, D]; near [P, k]: which are the nearest."""
    return (abs(x[:, None] - y[near]) ** norm).sum(-1)


def chamfer_normals(xp, a, b, there, back, signed):
    """Normals [P, 3] and [Q, 3]; there [P] and back [Q]: which point is nearest."""

    def apart(a, b):
        cosine = (a * b).sum(-1) / ((a**2).sum(-1) * (b**2).sum(-1)) ** 0.5
        return 1 - (cosine if signed else abs(cosine))

    return apart(a, b[there]).mean() + apart(b, a[back]).mean()


def mask_iou(xp, a, b):
    """[N, H, W]."""
    both, either = (a * b).sum(-1).sum(-1), (a + b - a * b).sum(-1).sum(-1)
    return 1 - (both / (either + 1e-10)).mean()


def l1(xp, image, target):
    return abs(image - target).mean()


def l2(xp, image, target):
    return ((image - target) ** 2).mean()


def edge_length(xp, positions, edges, target):
    lengths = ((positions[edges[:, 0]] - positions[edges[:, 1]]) ** 2).sum(-1) ** 0.5
    return ((lengths - target) ** 2).mean()


def laplacian_norm(xp, positions, adjacency):
    """adjacency [V, V]: 1 between neighbours; with the weights of `cotangents` it is laplacian_cotangent."""
    means = (adjacency[:, :, None] * positions[None]).sum(1) / adjacency.sum(1)[:, None]
    return (((means - positions) ** 2).sum(-1) ** 0.5).mean()


def cotangents(positions, faces):
    """Half the cotangents of the angles opposite to each edge, [V, V]; NumPy alone."""
    import numpy as np

    weights = np.zeros((len(positions),) * 2, positions.dtype)
    for k in range(3):
        a, b, apex = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        u, v = positions[a] - positions[apex], positions[b] - positions[apex]
        half = (u * v).sum(-1) / (cross(np, u, v) ** 2).sum(-1) ** 0.5 / 2
        np.add.at(weights, (a, b), half)
        np.add.at(weights, (b, a), half)
    return weights


def cross(xp, a, b):
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return xp.stack([x, y, z], -1)


def normal_consistency(xp, positions, pairs):
    """pairs [P, 4]: the two ends of an edge, and the corners opposite to it in the faces that share it."""
    a, b, c, d = (positions[pairs[:, k]] for k in range(4))
    first, second = cross(xp, b - a, c - a), -cross(xp, b - a, d - a)
    cosine = (first * second).sum(-1) / ((first**2).sum(-1) * (second**2).sum(-1)) ** 0.5
    return (1 - cosine).mean()


def surface_points(xp, positions, corner, share):
    """corner [P, 3], indices of vertices; share [P, 3]."""
    return (positions[corner] * share[:, :, None]).sum(1)
