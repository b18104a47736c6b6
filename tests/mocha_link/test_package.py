"""What `import mocha_link` gives: every public name, each from its module when it is asked for."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import mocha_link

STUBS = Path(mocha_link.__file__).with_suffix(".pyi")


def imports_for_type_checkers():
    for node in ast.walk(ast.parse(STUBS.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("mocha_link."):
            yield from ((alias.name, node.module) for alias in node.names)


def test_type_checkers_and_programs_find_the_same():
    homes = dict(imports_for_type_checkers())
    assert sorted(homes) == mocha_link.__all__
    assert homes == {
        name: f"mocha_link.{module}"
        for module, names in mocha_link._NAMES.items()
        for name in names
    }
    for name, module in homes.items():
        assert getattr(mocha_link, name) is getattr(importlib.import_module(module), name)
    assert set(mocha_link.__all__) <= set(dir(mocha_link))


def test_what_is_not_there_is_told_as_ever():
    with pytest.raises(AttributeError, match="module 'mocha_link' has no attribute 'Nodes'"):
        _ = mocha_link.Nodes
    with pytest.raises(ImportError, match="cannot import name 'Nodes' from 'mocha_link'"):
        exec("from mocha_link import Nodes")  # noqa: S102 - as a program would


def test_a_part_does_not_load_the_rest():
    script = (
        "import sys\nfrom mocha_link import Header\n"
        "assert Header.__module__ == 'mocha_link.store.record'\n"
        "assert not {'numpy', 'pydantic', 'yaml', 'zmq', 'lz4'} & {*sys.modules}\n"
        "from mocha_link import *\n"
        "assert Node.__module__ == 'mocha_link.node.node'\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
