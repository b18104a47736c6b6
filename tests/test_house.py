"""The rules of the house that can be checked: who imports whom, no circles, one noun a file.

Every import counts, at the top of a file or within a function. A room is a folder; a package's own
root is one as well. `__main__` stands outside: it starts the program.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import networkx as nx

from tests.imports import imports_in

ROOT = Path(__file__).parents[1]
ALLOWED = {
    "geo": {"geo"},
    "mocha_link": {"mocha_link"},
    "air_router": {"air_router", "geo", "mocha_link"},
    "sitl": {"sitl", "air_router", "geo", "mocha_link"},
}
FILE_LINES = 800


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    return {
        name_of(path): path
        for package in ALLOWED
        for path in sorted((ROOT / package).rglob("*.py"))
        if path.name != "__main__.py"
    }


def imports(module: str) -> Iterator[str]:
    """The modules of ours that a module imports, packages' faces among them."""
    for source, name in imports_in(modules()[module].read_text("utf-8"), deep=True):
        assert not source.startswith("."), f"{module}: relative import"
        if source.split(".")[0] in ALLOWED:
            deeper = f"{source}.{name}"
            yield deeper if deeper in modules() else source


@cache
def arrows() -> set[tuple[str, str]]:
    return {(module, name) for module in modules() for name in imports(module) if name != module}


def circles(edges: set[tuple[object, object]]) -> list[list[object]]:
    parts = nx.strongly_connected_components(nx.DiGraph(edges))
    return [sorted(map(str, part)) for part in parts if len(part) > 1]


def test_no_arrow_runs_up():
    up = [
        (module, name)
        for module, name in arrows()
        if name.split(".")[0] not in ALLOWED[module.split(".")[0]]
    ]
    assert up == []


def test_no_circle_between_files():
    assert circles({arrow for arrow in arrows() if arrow[1] in modules()}) == []


def test_no_circle_between_rooms():
    rooms = {
        (modules()[module].parent, modules()[name].parent)
        for module, name in arrows()
        if name in modules() and modules()[module].parent != modules()[name].parent
    }
    assert circles(rooms) == []


def test_no_import_is_for_types_only():
    texts = {name: path.read_text("utf-8") for name, path in modules().items()}
    assert [name for name, text in texts.items() if "TYPE_CHECKING" in text] == []


def test_rooms_say_what_they_are_for():
    rooms = sorted({path.parent for path in modules().values()})
    silent = [
        str(room.relative_to(ROOT))
        for room in rooms
        if not ast.get_docstring(ast.parse((room / "__init__.py").read_text("utf-8")))
    ]
    assert silent == []


def test_files_hold_one_noun():
    lines = {name: len(path.read_text("utf-8").splitlines()) for name, path in modules().items()}
    assert {name: count for name, count in lines.items() if count > FILE_LINES} == {}
