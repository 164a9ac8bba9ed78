"""Meshes, images and cameras in and out."""

import copy
import pickle
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

import unsphere as us


@pytest.mark.parametrize("kind", ["obj", "ply", "glb", "stl"])
def test_meshes_come_back(kind, tmp_path):
    mesh = us.torus()
    mesh.colors = np.random.default_rng(0).uniform(size=mesh.vertices.shape).astype(np.float32)
    us.write_mesh(tmp_path / f"mesh.{kind}", mesh)
    read = us.read_mesh(str(tmp_path / f"mesh.{kind}"))
    assert read.is_watertight and read.volume == pytest.approx(mesh.volume, rel=1e-5)
    if kind != "stl":
        assert np.allclose(read.vertices, mesh.vertices) and np.array_equal(read.faces, mesh.faces)
    if kind in ("obj", "ply"):
        assert np.allclose(read.colors, mesh.colors, atol=1 / 255)


def test_a_3mf_has_all_triangles(tmp_path):
    mesh = us.icosphere(1)
    us.write_mesh(tmp_path / "ball.3mf", mesh)
    with zipfile.ZipFile(tmp_path / "ball.3mf") as archive:
        (model,) = [name for name in archive.namelist() if name.endswith(".model")]
        root = ElementTree.fromstring(archive.read(model))
    triangles = root.findall(".//{*}triangle")
    assert len(root.findall(".//{*}vertex")) == len(mesh.vertices) and len(triangles) == len(mesh.faces)
    found = np.array([[int(t.get(v)) for v in ("v1", "v2", "v3")] for t in triangles])
    assert np.array_equal(found, mesh.faces)


def test_a_texture_comes_back(tmp_path):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    image = np.random.default_rng(0).uniform(size=(8, 4, 3)).astype(np.float32)
    us.write_mesh(tmp_path / "square.obj", us.Mesh(square, faces, uv=square[:, :2].copy(), uv_faces=faces, texture=image))
    read = us.read_mesh(tmp_path / "square.obj")
    assert np.allclose(read.texture, image, atol=1 / 255) and np.allclose(read.uv[read.uv_faces], square[faces][..., :2])


def test_meshes_are_the_callers_arrays():
    vertices, faces = us.icosphere(0).vertices, us.icosphere(0).faces
    mesh = us.Mesh(vertices, faces)
    assert mesh.vertices is vertices and mesh.faces is faces
    mesh.vertices *= 2
    assert mesh.area == pytest.approx(4 * us.icosphere(0).area)
    assert us.Mesh(vertices.astype(np.float64), faces.astype(np.int64)).vertices.dtype == np.float32
    mesh.vertices = np.full((12, 3), np.nan, np.float32)
    with pytest.raises(ValueError, match="vertex 0 is at"):
        mesh.volume
    assert "watertight" in us.torus().health() and us.torus().self_intersections() == 0
    assert len(us.icosphere(1).subdivided().faces) == 320


def test_files_that_cannot_be_had(tmp_path):
    with pytest.raises(FileNotFoundError, match="none.ply"):
        us.read_mesh(tmp_path / "none.ply")
    broken = tmp_path / "broken.obj"
    broken.write_text("v 0 0 0\nf 1 2 3\n")
    with pytest.raises(OSError, match="broken.obj"):
        us.read_mesh(broken)
    with pytest.raises(OSError):
        us.write_mesh(tmp_path / "mesh.xyz", us.icosphere(1))
    with pytest.raises(OSError):
        us.write_png(tmp_path / "no" / "image.png", np.zeros((2, 2)))


def test_images(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    us.write_png(tmp_path / "image.png", image)
    assert np.array_equal(us.read_image(tmp_path / "image.png"), image)
    us.write_png(tmp_path / "image.png", image / 255)
    assert np.array_equal(us.read_image(tmp_path / "image.png"), image)


def test_cameras_of_other_tools():
    camera = us.Camera.look_at([1, 2, 3], [0.1, 0, 0], fov_y=0.7, width=48, height=36)
    assert np.allclose(camera.center, [1, 2, 3]) and camera.is_perspective
    fx, fy, cx, cy = camera.intrinsics
    to_world = np.eye(4)
    to_world[:3, :3] = np.array(camera.rotation).T
    to_world[:3, 3] = camera.center
    assert np.allclose(us.Camera.from_opengl(to_world, fx, fy, cx, cy, 48, 36).matrix, camera.matrix)
    flip = np.diag([1.0, -1.0, -1.0])
    opencv = us.Camera.from_opencv(flip @ camera.rotation, flip @ camera.translation, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], 48, 36)
    assert np.allclose(opencv.matrix, camera.matrix)
    turn = np.diag([-1.0, 1.0, -1.0])
    torch3d = us.Camera.from_pytorch3d((turn @ camera.rotation).T, turn @ camera.translation, [2 * fx / 36, 2 * fy / 36], width=48, height=36)
    assert np.allclose(torch3d.matrix, camera.matrix)
    point = np.array([[0.3, -0.2, 0.1]])
    x, y, depth = us.project(point, us.matrices([camera], "float64")).value[0, 0]
    homogeneous = camera.matrix @ [*point[0], 1]
    assert np.allclose([x, y, depth], [*(homogeneous[:2] / homogeneous[2]), homogeneous[2]])
    assert camera == us.Camera.look_at([1, 2, 3], [0.1, 0, 0], fov_y=0.7, width=48, height=36) != camera.resized(24, 18)


COPIES = {"pickle": lambda x: pickle.loads(pickle.dumps(x)), "copy": copy.copy, "deepcopy": copy.deepcopy}


@pytest.mark.parametrize("kind", COPIES)
def test_copies(kind):
    again = COPIES[kind]
    cameras = [
        us.Camera.look_at([1, 2, 3], [0.1, 0, 0], fov_y=0.7, width=48, height=36),
        us.Camera.orthographic(np.eye(3), [0.1, 0.2, -3], [20, 21], [23, 18], 48, 36),
    ]
    assert again(cameras) == cameras and not cameras[1].is_perspective
    mesh = us.torus()
    mesh.colors = np.random.default_rng(0).uniform(size=mesh.vertices.shape).astype(np.float32)
    topology = again(mesh.topology())
    assert topology.vertices == len(mesh.vertices) and np.array_equal(topology.faces, mesh.faces)
    faces = np.array([[0, 1, 2]], np.uint32)
    square = us.Mesh(np.eye(3), faces, uv=np.eye(3)[:, :2], uv_faces=faces, texture=np.full((2, 2, 3), 0.3))
    for own in (mesh, square):
        other = again(own)
        for name in "vertices faces colors uv uv_faces texture".split():
            a, b = getattr(own, name), getattr(other, name)
            assert (a is None) == (b is None) and (a is None or np.array_equal(a, b)), name
        assert np.shares_memory(own.vertices, other.vertices) == (kind == "copy")


def test_figures():
    random = np.random.default_rng(0)
    image = random.uniform(size=(20, 24, 3)).astype(np.float32)
    assert us.metrics.psnr(image, image) == np.inf and us.metrics.ssim(image, image) == pytest.approx(1)
    assert us.metrics.psnr(image, image + 0.1) == pytest.approx(20, abs=1e-3)
    half = np.zeros((4, 4), np.float32)
    half[:2] = 1
    assert us.metrics.iou(half, np.ones((4, 4), np.float32)) == 0.5
    batch = np.stack([half, np.ones((4, 4), np.float32)])
    assert us.metrics.iou(batch, np.ones((2, 4, 4), np.float32)) == 0.75
    assert us.metrics.iou(batch[..., None], batch[..., None]) == 1
    found = us.metrics.point_distances(np.zeros((1, 3)), np.array([[3.0, 4.0, 0.0], [9.0, 0.0, 0.0]]), [6.0])
    assert found["chamfer"] == 12 and found["accuracy"].tolist() == [5] and found["f_scores"][0]["recall"] == 0.5
    ball = us.icosphere(2)
    report = us.metrics.evaluate(ball, ball)
    assert report["chamfer"] == 0 and report["protocol"]["name"] == "meshrcnn"
    assert us.metrics.voxel_iou(ball, ball) == 1
