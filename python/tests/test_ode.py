"""Differential equations with fields written in Python."""

import numpy as np
import pytest

import unsphere as us


def test_methods_and_times():
    for method in "euler heun midpoint rk4 bosh3 dopri5 heun3 three_eighths adaptive_heun tsit5".split():
        found = us.odeint(lambda t, y: -y, np.ones(2), (0.0, 1.0), method=method, step=1e-3, save_at=[0.25, 0.5])
        tolerance = 1e-3 if method == "euler" else 1e-6
        assert np.allclose(found.end, np.exp(-1), atol=tolerance)
        assert np.allclose(found.states, np.exp([[-0.25] * 2, [-0.5] * 2]), atol=tolerance)
        assert found.accepted == 1000 and len(found.times) == 1001


def test_steps_follow_the_error():
    spin = np.array([[0.0, -1.0], [1.0, 0.0]])
    found = us.odeint(lambda t, y: y @ spin, np.eye(2), (0.0, np.pi / 2), rtol=1e-9, atol=1e-9)
    assert found.end.shape == (2, 2) and np.allclose(found.end, spin, atol=1e-7)
    assert found.evaluations == 2 + 6 * (found.accepted + found.rejected)
    back = us.odeint(lambda t, y: y @ spin, found.end, (np.pi / 2, 0.0), rtol=1e-9, atol=1e-9)
    assert np.allclose(back.end, np.eye(2), atol=1e-7)


def test_a_state_without_axes():
    found = us.odeint(lambda t, y: -y, np.array(1.0), (0, 1), method="rk4", step=0.1)
    assert found.end.shape == () and abs(found.end - np.exp(-1)) < 1e-5


def test_single_precision_stays():
    seen = []
    found = us.odeint(lambda t, y: seen.append(y.dtype) or 2 * t * y, np.ones(3, np.float32), (0, 1), step=0.01, method="rk4")
    assert found.end.dtype == np.float32 and set(map(str, seen)) == {"float32"}
    assert np.allclose(found.end, np.e, rtol=1e-5)


@pytest.mark.parametrize("how", [{"step": 0.1}, {"rtol": 1e-6, "atol": 1e-6}])
def test_what_the_field_raises_is_raised(how):
    calls = []

    def field(t, y):
        calls.append(t)
        if len(calls) == 5:
            raise KeyError("no such thing")
        return -y

    with pytest.raises(KeyError, match="no such thing"):
        us.odeint(field, np.ones(2), (0, 1), **how)
    assert len(calls) == 5, "it is not asked again"


def test_mistakes():
    ones = np.ones(2)
    with pytest.raises(ValueError, match="method 'rk5', expected one of euler, heun"):
        us.odeint(lambda t, y: y, ones, (0, 1), method="rk5", step=0.1)
    with pytest.raises(ValueError, match="either step, or both rtol and atol"):
        us.odeint(lambda t, y: y, ones, (0, 1), rtol=1e-3)
    with pytest.raises(ValueError, match="rk4 estimates no error"):
        us.odeint(lambda t, y: y, ones, (0, 1), method="rk4", rtol=1e-3, atol=1e-3)
    with pytest.raises(ValueError, match=r"has the shape \[3\], expected \[2\] as y"):
        us.odeint(lambda t, y: np.ones(3), ones, (0, 1), step=0.1)
    with pytest.raises(ValueError, match="is float32, expected float64 as y"):
        us.odeint(lambda t, y: y.astype(np.float32), ones, (0, 1), step=0.1)
    with pytest.raises(TypeError, match="found a float"):
        us.odeint(lambda t, y: 1.0, ones, (0, 1), step=0.1)
    with pytest.raises(ValueError, match="infinite or not a number"):
        us.odeint(lambda t, y: y * np.inf, ones, (0, 1), step=0.1)
    with pytest.raises(ValueError, match="save_at"):
        us.odeint(lambda t, y: y, ones, (0, 1), step=0.1, save_at=[2.0])
