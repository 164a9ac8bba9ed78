"""The stubs say what the compiled module has, and every docstring says shapes."""

import ast
import inspect
import pathlib

import pytest

import unsphere as us
from unsphere import _unsphere

STUBS = ast.parse((pathlib.Path(us.__file__).parent / "_unsphere.pyi").read_text())
FUNCTIONS = {node.name: node for node in STUBS.body if isinstance(node, ast.FunctionDef)}
CLASSES = {node.name: node for node in STUBS.body if isinstance(node, ast.ClassDef)}


def offered(kind):
    return {name for name in dir(_unsphere) if not name.startswith("_") and inspect.isclass(getattr(_unsphere, name)) == kind}


def test_nothing_is_missing():
    assert offered(False) == set(FUNCTIONS) and offered(True) == set(CLASSES)
    for name, node in CLASSES.items():
        said = {part.name for part in node.body if isinstance(part, ast.FunctionDef)}
        said |= {part.target.id for part in node.body if isinstance(part, ast.AnnAssign)}
        has = {part for part in dir(getattr(_unsphere, name)) if not part.startswith("_")}
        assert has == {part for part in said if not part.startswith("_")}, name


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arguments_are_the_same(name):
    said, has = FUNCTIONS[name].args, inspect.signature(getattr(_unsphere, name)).parameters.values()
    assert [arg.arg for arg in said.args] == [p.name for p in has if p.kind != p.KEYWORD_ONLY]
    assert [arg.arg for arg in said.kwonlyargs] == [p.name for p in has if p.kind == p.KEYWORD_ONLY]
    defaults = [*said.defaults, *(default for default in said.kw_defaults if default is not None)]
    assert [ast.literal_eval(default) for default in defaults] == [p.default for p in has if p.default is not p.empty]


@pytest.mark.parametrize("name", us.__all__)
def test_everything_is_documented(name):
    offered = getattr(us, name)
    docs = inspect.getdoc(offered)
    assert docs and len(docs) > 40
    if name in FUNCTIONS:
        # Every argument is spoken of.
        for argument in inspect.signature(offered).parameters:
            assert argument in docs or argument in ("wrt", "path", "mesh"), argument
