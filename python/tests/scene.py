"""A small scene, and the functions of `unsphere` beside their plain twins."""

import numpy as np

import unsphere as us

SIZE = (20, 24)
SIGMA, BOX = 150.0, 0.25


class Scene:
    """Two views of a ball that is none any more."""

    def __init__(self, dtype):
        random = np.random.default_rng(5)
        ball = us.icosphere(1)
        self.dtype, self.topology = np.dtype(dtype), ball.topology()
        self.vertices = (ball.vertices + 0.06 * random.standard_normal(ball.vertices.shape)).astype(dtype)
        eyes = [[0.3, 0.2, 3.0], [2.5, -0.4, 1.5]]
        cameras = [us.Camera.look_at(eye, [0, 0, 0], width=SIZE[1], height=SIZE[0]) for eye in eyes]
        self.matrices = us.matrices(cameras, self.dtype.name)
        self.projected = np.array(us.project(self.vertices, self.matrices).value)
        self.frame = us.rasterize(self.projected, self.topology, *SIZE, sigma_inv=SIGMA, box_length=BOX)
        self.faces = self.topology.faces.astype(np.int64)
        face = self.frame.face
        image, row, column = np.nonzero(face >= 0)
        self.pixels = image, row, column, face[image, row, column]
        height, width = SIZE
        x = (2 * np.arange(width) + 1 - width) / width
        y = (height - 2 * np.arange(height) - 1) / height
        self.grid = np.stack(np.broadcast_arrays(x[None], y[:, None]), -1).astype(dtype)
        self.centres = self.grid[row, column]
        self.colors = random.uniform(size=(len(self.vertices), 3)).astype(dtype)
        self.image = random.uniform(size=(6, 5, 3)).astype(dtype)
        self.uv = random.uniform(0.02, 0.98, (2, *SIZE, 2)).astype(dtype)
        self.points = (1.1 * random.standard_normal((60, 3))).astype(dtype)
        self.masks = random.uniform(0.1, 0.9, (2, *SIZE)).astype(dtype)
        self.photos = random.uniform(size=(2, *SIZE, 3)).astype(dtype)
        self.edges = self.topology.edges.astype(np.int64)
        self.adjacency = np.zeros((len(self.vertices),) * 2, dtype)
        self.adjacency[self.edges[:, 0], self.edges[:, 1]] = self.adjacency[self.edges[:, 1], self.edges[:, 0]] = 1
        self.samples = us.sample_surface(self.vertices, self.topology, 40, seed=1)
        self.pairs = self.opposite()

    def opposite(self):
        """For each edge its ends and the corners opposite."""
        found = []
        for a, b in self.edges:
            others = [int(v) for face in self.faces if a in face and b in face for v in face if v not in (a, b)]
            found.append([a, b, *others])
        return np.array(found)
