"""The lessons find what they are to find; where PyTorch is installed, with it too."""

import importlib.util
import pathlib
import sys

import numpy as np
import pytest

import unsphere as us

LESSONS = pathlib.Path(__file__).parents[1] / "lessons"
BACKENDS = ["numpy", pytest.param("torch", marks=pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="PyTorch is not installed"))]


def lesson(name):
    spec = importlib.util.spec_from_file_location(name, LESSONS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def written(path, picture):
    us.write_png(path, picture)
    read = us.read_image(path)
    assert read.shape == picture.shape and np.abs(read / 255 - picture).max() < 0.01


@pytest.mark.parametrize("backend", BACKENDS)
def test_fit_a_mesh(backend, tmp_path):
    module = lesson("fit_a_mesh")
    fit = module.fit if backend == "numpy" else module.fit_torch
    vertices, colors, topology, losses = fit(120)
    assert losses[-1] < 0.25 * losses[0]
    truth, cameras = module.vase(), module.cameras()
    masks, images = module.draw(truth.vertices, truth.colors, truth.topology(), cameras)
    found, drawn = module.draw(vertices, colors, topology, cameras)
    start, _ = module.draw(*module.start(), cameras)
    ious = [us.metrics.iou(a, b) for a, b in zip(found, masks)]
    before = [us.metrics.iou(a, b) for a, b in zip(start, masks)]
    assert min(ious) > 0.95 > 0.85 > max(before)
    assert np.mean([us.metrics.psnr(a, b) for a, b in zip(drawn, images)]) > 22
    written(tmp_path / "picture.png", module.picture(vertices, colors, topology))


@pytest.mark.parametrize("backend", BACKENDS)
def test_deform_a_sphere(backend, tmp_path):
    module = lesson("deform_a_sphere")
    mesh = module.scan(tmp_path)
    deform = module.deform if backend == "numpy" else module.deform_torch
    topology, shapes, distances = deform(mesh, 300)
    # What is left is what two sets of points of one surface differ by.
    both = [us.sample_surface(mesh.vertices, mesh.topology(), module.POINTS, seed=seed) for seed in (0, 1)]
    points = [us.surface_points(mesh.vertices, mesh.topology(), own).value for own in both]
    noise = us.chamfer(*points).value
    assert distances[-1] < 1.5 * noise < 0.02 * distances[0]
    found = us.Mesh(shapes[-1], topology.faces)
    assert us.metrics.voxel_iou(found, mesh) > 0.95
    assert us.normal_consistency(shapes[-1], topology).value < 0.02
    written(tmp_path / "picture.png", module.picture(mesh, topology, shapes))


@pytest.mark.parametrize("backend", BACKENDS)
def test_dibr_texture(backend, tmp_path):
    module = lesson("dibr_texture")
    texture, losses = (module.fit if backend == "numpy" else module.fit_torch)()
    assert losses[-1] < 1e-3 * losses[0]
    assert us.metrics.psnr(module.new_view(texture), module.new_view(module.painting())) > 40
    written(tmp_path / "picture.png", module.picture(texture))


@pytest.mark.parametrize("name", ["fit_a_mesh", "deform_a_sphere", "dibr_texture"])
def test_what_a_lesson_is_told(name, tmp_path, monkeypatch, capsys):
    module = lesson(name)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        module.main(["--help"])
    assert ended.value.code == 0 and f"{name}.png" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        module.main(["--touch"])
    # `--torch` is no name of a picture.
    began = RuntimeError("PyTorch's way began")
    monkeypatch.setattr(module, {"deform_a_sphere": "deform_torch"}.get(name, "fit_torch"), lambda *_: (_ for _ in ()).throw(began))
    with pytest.raises(RuntimeError, match="way began"):
        module.main(["--torch"])
    assert not list(tmp_path.iterdir())


def test_gradients_passed_back_by_hand():
    """Lesson 1's chain, in double precision, beside central differences of its whole loss."""
    module = lesson("fit_a_mesh")
    truth, matrices = module.vase(), module.cameras()
    masks, images = module.draw(truth.vertices, truth.colors, truth.topology(), matrices)
    known = [array.astype(np.float64) for array in (matrices, masks, images)]
    vertices, colors, topology = module.start()
    vertices, colors = vertices.astype(np.float64), colors.astype(np.float64)
    _, of_vertices, of_colors = module.loss_and_gradients(vertices, colors, topology, *known)

    def slope(vertex, color, step=1e-6):
        loss = lambda sign: module.loss_and_gradients(vertices + sign * step * vertex, colors + sign * step * color, topology, *known)[0]
        return (loss(1) - loss(-1)) / (2 * step)

    random, close = np.random.default_rng(3), 0
    for _ in range(10):
        vertex, color = (random.standard_normal(vertices.shape) * (random.uniform(size=vertices.shape) < 0.002) for _ in range(2))
        expected = np.sum(of_vertices * vertex) + np.sum(of_colors * color)
        close += slope(vertex, color) == pytest.approx(expected, rel=1e-3, abs=1e-8)
    assert close >= 8, "a pixel that changes its face spoils a difference, not most of them"
