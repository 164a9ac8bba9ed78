"""The README's Python runs, its links lead somewhere, and what it names is there."""

import inspect
import operator
import pathlib
import re

import numpy as np
import pytest

import unsphere as us

FOLDER = pathlib.Path(__file__).parents[1]
TEXT = (FOLDER / "README.md").read_text()


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    assert len(code.strip().splitlines()) <= 14
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code, names)
    told = re.search(r"# ([\d.]+): the share", code)[1]
    assert round(float(capsys.readouterr().out), 2) == float(told)
    assert us.read_image("mask.png").shape == (64, 64, 1)
    ball, before = names["ball"], us.icosphere(3)
    assert np.linalg.norm(ball.vertices, axis=1).max() > 1.001 * np.linalg.norm(before.vertices, axis=1).max()


def test_links_and_names():
    for target in re.findall(r"\]\((?!https:)([^)]+)\)", TEXT):
        assert (FOLDER / target).exists() or not (FOLDER.parent / "docs").exists(), target
    table = TEXT.split("| for | functions |")[1].split("\n\n")[0]
    for name in re.findall(r"`\.?([A-Za-z_0-9]+)[`.]", table):
        assert any(hasattr(home, name) for home in (us, us.metrics, us.Camera, us.Views)), name
    missing = [name for name in us.__all__ if name not in TEXT and name not in ("Adam", "Fitted", "Solution", "SurfaceSamples")]
    assert not missing


def test_what_functions_of_others_are_called():
    """The column "Python" of docs/coming-from.md names what is there, and has a dash only for what is not."""
    page = FOLDER.parent / "docs" / "coming-from.md"
    if not page.exists():
        pytest.skip("the bindings stand alone here")
    rows = [line.strip("|").split("|") for line in page.read_text().splitlines() if line.startswith("| ")]
    rows = [[cell.strip() for cell in row] for row in rows if len(row) == 4 and row[1].strip() != "Rust"]
    assert len(rows) > 30
    for _, rust, python, _ in rows:
        names = re.findall(r"`([A-Za-z_0-9.]+)`", python)
        found = [operator.attrgetter(name)(us) for name in names]
        for argument in re.findall(r"\b([a-z_]+)=", python):
            assert any(argument in inspect.signature(one).parameters for one in found), argument
        missing = [name for name in re.findall(r"(?:\w+::)?(\w+)[`(]", rust) if name in us.__all__] if python == "-" else []
        assert (names or python == "-") and not missing, (python, missing)
