"""The README's Python runs, its links lead somewhere, and what it names is there."""

import pathlib
import re

import numpy as np

import unsphere as us

FOLDER = pathlib.Path(__file__).parents[1]
TEXT = (FOLDER / "README.md").read_text()


def test_the_example_runs():
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    assert len(code.strip().splitlines()) <= 12
    names = {}
    exec(code, names)
    ball, before = names["ball"], us.icosphere(3)
    assert np.linalg.norm(ball.vertices, axis=1).max() > 1.001 * np.linalg.norm(before.vertices, axis=1).max()


def test_links_and_names():
    for target in re.findall(r"\]\(([^)]+)\)", TEXT):
        assert (FOLDER / target).exists() or not (FOLDER.parent / "docs").exists(), target
    table = TEXT.split("| for | functions |")[1].split("\n\n")[0]
    for name in re.findall(r"`\.?([A-Za-z_0-9]+)[`.]", table):
        assert any(hasattr(home, name) for home in (us, us.metrics, us.Camera, us.Views)), name
    missing = [name for name in us.__all__ if name not in TEXT and name not in ("Adam", "Fitted", "Solution", "SurfaceSamples")]
    assert not missing
