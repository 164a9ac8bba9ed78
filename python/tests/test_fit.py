"""A fit: its callback, its end, and Ctrl-C."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import unsphere as us

SIZE = 64


def views(count=12):
    """Images of an ellipsoid from all around."""
    ball = us.icosphere(3)
    shape = ball.vertices * np.array([1.0, 0.6, 0.8], np.float32)
    angles = 2 * np.pi * np.arange(count) / count
    cameras = [us.Camera.look_at([3 * np.sin(a), (-1) ** i, 3 * np.cos(a)], [0, 0, 0], width=SIZE, height=SIZE) for i, a in enumerate(angles)]
    frame = us.rasterize(us.project(shape, us.matrices(cameras)).value, ball.topology(), SIZE, SIZE)
    red = (frame.mask[..., None] * np.array([200, 30, 40])).astype(np.uint8)
    return us.Views(red, frame.mask > 0, cameras)


def test_a_fit_tells_of_its_steps():
    told = []
    found = us.fit(views(), lambda *step: told.append(step), start_level=2, level=3, steps=40)
    assert found.completed and len(told) == len(found.losses)
    steps, totals, losses = zip(*told)
    assert list(steps) == list(range(1, len(told) + 1)) and max(steps) <= totals[0]
    assert np.allclose(losses, found.losses) and losses[-1] < 0.4 * losses[0]
    mesh = found.mesh
    assert mesh.is_watertight and len(mesh.vertices) == 642 and mesh.colors[:, 0].mean() > 0.6
    assert found.evaluations[-1][1] > 0.9 and list(found.held_out_views) == [4, 9]


def test_a_callback_ends_it():
    found = us.fit(views(), lambda step, total, loss: step < 7, level=4)
    assert not found.completed and len(found.losses) == 7 and found.mesh.is_watertight


def test_what_a_callback_raises_is_raised():
    def callback(step, total, loss):
        if step == 3:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        us.fit(views(), callback)


def test_ctrl_c_ends_it():
    # What is begun in the background of a shell is begun deaf to it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    start = time.perf_counter()
    press = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    # It would go on for minutes; nobody calls it back.
    long = {"start_level": 5, "level": 5, "steps": 100_000, "tolerance": 0.0}
    together = views()
    press.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            us.fit(together, **long)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.perf_counter() - start < 30


def test_mistakes():
    with pytest.raises(ValueError, match="levle"):
        us.fit(views(), levle=2)
    with pytest.raises(ValueError, match="expected one of `seed`, `hold_out`, `start_level`"):
        us.fit(views(), lvl=3)
    with pytest.raises(ValueError, match="`level` is 2, expected at least `start_level`, 4"):
        us.fit(views(), level=2, start_level=4)
    with pytest.raises(ValueError, match="masks are empty in all 12 views"):
        own = views()
        us.fit(us.Views(np.stack([own.color(i) for i in range(12)]), np.zeros((12, SIZE, SIZE), bool), own.cameras))
    with pytest.raises(ValueError, match="12 images, 12 masks and 11 cameras"):
        us.Views(np.zeros((12, 8, 8, 3), np.uint8), np.zeros((12, 8, 8), bool), views().cameras[:11])
    with pytest.raises(ValueError, match="masks fill their images in all 12 views"):
        us.fit(us.Views(np.zeros((12, SIZE, SIZE, 3), np.uint8), np.ones((12, SIZE, SIZE), bool), own.cameras))
    wide = us.Camera.look_at([0, 0, 3], [0, 0, 0], width=16, height=8)
    with pytest.raises(ValueError, match="are the camera's height and width swapped"):
        us.Views(np.zeros((1, 16, 8, 3), np.uint8), np.zeros((1, 16, 8), bool), [wide])


def test_views_of_floats():
    own = views()
    colors = np.stack([own.color(i) for i in range(12)])
    share = np.where(np.stack([own.mask(i) for i in range(12)]) > 0, 0.5, 0.49)
    for kind in (np.float32, np.float64):
        made = us.Views((colors / 255).astype(kind), list(share.astype(kind)), own.cameras)
        assert all(np.array_equal(made.color(i), own.color(i)) and np.array_equal(made.mask(i), own.mask(i)) for i in range(12))
    with pytest.raises(ValueError, match="Views: colors: values in .0, 1. expected, found"):
        us.Views(colors.astype(np.float32), share, own.cameras)
    with pytest.raises(TypeError, match="Views: colors: arrays of uint8, or of floats in .0, 1., expected, found an array of int64"):
        us.Views(colors.astype(np.int64), share, own.cameras)
    with pytest.raises(TypeError, match="Views: masks: arrays of uint8, .* found a list"):
        us.Views(colors, share.tolist(), own.cameras)


def test_views_are_written_and_read(tmp_path):
    own = views()
    own.write(tmp_path / "views")
    read = us.read_views(tmp_path / "views")
    assert len(read) == 12 and np.array_equal(read.mask(3), own.mask(3)) and np.array_equal(read.color(3), own.color(3))
    for a, b in zip(own.cameras, read.cameras):
        assert np.allclose(a.matrix, b.matrix)
    assert read.cameras[0].width == SIZE
    small = us.read_views(tmp_path / "views", max_size=32)
    assert small.color(0).shape == (32, 32, 3) and small.cameras[0].height == 32
    with pytest.raises(OSError, match="nowhere"):
        us.read_views(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="max_sise"):
        us.read_views(tmp_path / "views", max_sise=3)
