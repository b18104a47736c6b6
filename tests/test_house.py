"""The rules of the house that can be checked: who imports whom, and no circles."""

import ast
from pathlib import Path

import networkx as nx

ROOT = Path(__file__).parents[1]
ALLOWED = {
    "geo": set(),
    "mocha_link": set(),
    "air_router": {"geo", "mocha_link"},
    "sitl": {"geo", "mocha_link", "air_router"},
}
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for package in ALLOWED
    for path in sorted((ROOT / package).rglob("*.py"))
}


def imports(path, *, typing_too):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = set()
    if not typing_too:
        for node in ast.walk(tree):
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                skipped.update(id(inner) for inner in ast.walk(node))
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_no_arrow_runs_up():
    for module, path in MODULES.items():
        package = module.split(".")[0]
        others = {name.split(".")[0] for name in imports(path, typing_too=True)}
        assert others & set(ALLOWED) <= ALLOWED[package] | {package}, module


def test_no_circle_between_files():
    graph = nx.DiGraph(
        (module, name)
        for module, path in MODULES.items()
        for name in imports(path, typing_too=False)
        if name in MODULES and name != module and not name.endswith("__init__")
    )
    assert list(nx.simple_cycles(graph)) == []


def test_modules_stay_small():
    lines = {name: path.read_text(encoding="utf-8").count("\n") for name, path in MODULES.items()}
    assert {name: count for name, count in lines.items() if count > 450} == {}
