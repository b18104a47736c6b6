"""The rules of the house that can be checked: who imports whom, doors, no circles, one noun a file.

Every import counts, at the top of a file or within a function. A room is a folder, its door the
`__init__.py`: what other rooms may use stands in its `__all__`. The modules at the root of a
package (`geo.frame`, `air_router.errors`) are doors themselves. `__main__` stands outside: it
starts the program. The tests of a room may look inside.
"""

import ast
import inspect
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import networkx as nx
import pytest

from tests.imports import imports_in, late_homes

ROOT = Path(__file__).parents[1]
ALLOWED = {
    "geo": {"geo"},
    "mocha_link": {"mocha_link"},
    "air_router": {"air_router", "geo", "mocha_link"},
    "sitl": {"sitl", "air_router", "geo", "mocha_link"},
}
FILE_LINES = 800
FIELDS = 15
FEW_FIELDS = ("mocha_link.sync",)  # rooms in which no class has more
NAMES = 20
MORE_NAMES = {  # doors with more names, and why
    "mocha_link": "the whole library, for programs that embed it",
    "air_router.controller.targets": "what a seek policy is made of, ours or another package's",
    "air_router.controller.model": "a vocabulary: each event, action and request is a name",
    "air_router.files": "what any reader needs: JSON, XML and YAML text, the form of a mission",
    "air_router.files.maps": "each format that is read or written is a name",
    "air_router.mission": "a mission, its fleet, its plan on board, and how each is read",
    "air_router.vehicle": "the port: each event, each measurement, each instruction is a name",
    "air_router.web": "what the four pages share",
    "mocha_link.links": "a vocabulary: each event of a link is a name",
    "mocha_link.store": "a message and the header, which the wire gives its constants",
    "mocha_link.sync": "actions of the protocol, each a name",
    "mocha_link.team": "a team, its keys, and the mistakes of its file",
    "sitl.experiment": "a run's settings and its plan, for the rooms that make it",
    "sitl.px4sim": "the autopilot's own types, which its motion and its wire share",
    "sitl.rehearsal": "the parts of a scene, for the two ways to fly it",
    "sitl.rehearsal.judge": "the kinds of evidence, for the two ways to gather it",
    "sitl.world.towns": "a town, its terrain and its ways",
}


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
    """The modules of ours that a module imports, doors among them, and what is behind late ones."""
    for source, name in imports_in(modules()[module].read_text("utf-8"), deep=True):
        assert not source.startswith("."), f"{module}: relative import"
        if source.split(".")[0] in ALLOWED:
            deeper = f"{source}.{name}"
            yield deeper if deeper in modules() else source
            if source in doors() and name in (late := late_homes(modules()[source])):
                yield late[name]


@cache
def doors() -> dict[str, set[str]]:
    """The names at each door."""
    rooms = [name for name, path in modules().items() if path.name == "__init__.py"]
    return {room: {*getattr(import_module(room), "__all__", ())} for room in rooms}


def room_of(module: str) -> str:
    return module if module in doors() else module.rpartition(".")[0]


@cache
def past_doors() -> list[str]:
    """Each import of a room's inside from another room."""
    found = []
    for path in [*modules().values(), *sorted((ROOT / "benchmarks").rglob("*.py"))]:
        here = room_of(name_of(path))
        for source, name in imports_in(path.read_text("utf-8"), deep=True):
            there = room_of(source)
            if source.split(".")[0] not in ALLOWED or there in {here, *ALLOWED}:
                continue
            inside = source != there or name not in doors()[there] | {None}
            if inside and f"{source}.{name}" not in doors():
                found.append(f"{name_of(path)}: from {source} import {name}")
    return found


@cache
def arrows() -> set[tuple[str, str]]:
    return {(module, name) for module in modules() for name in imports(module) if name != module}


def circles(edges: set[tuple[object, object]]) -> list[list[object]]:
    parts = nx.strongly_connected_components(nx.DiGraph(edges))
    return [sorted(map(str, part)) for part in parts if len(part) > 1]


def test_benchmarks_stand_below_the_tests():
    """Tests may use what is measured with; the other way round there would be a circle."""
    up = [
        (str(path.relative_to(ROOT)), source)
        for path in sorted((ROOT / "benchmarks").rglob("*.py"))
        for source, _ in imports_in(path.read_text("utf-8"), deep=True)
        if source.split(".")[0] == "tests"
    ]
    assert up == []


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


def test_rooms_state_what_they_are_for():
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


def fields(made: ast.ClassDef) -> set[str]:
    """What the methods of a class set on the object, and what a dataclass declares."""
    declared = {
        node.target.id
        for node in made.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    return declared | {
        node.attr
        for node in ast.walk(made)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and ast.unparse(node.value) == "self"
    }


@pytest.mark.parametrize("room", FEW_FIELDS)
def test_a_class_has_few_fields(room):
    """With more there are other nouns in it."""
    counts = {
        f"{module}.{made.name}": len(fields(made))
        for module, path in modules().items()
        if room_of(module) == room
        for made in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(made, ast.ClassDef)
    }
    assert {name: count for name, count in counts.items() if count > FIELDS} == {}


def test_rooms_are_entered_by_their_doors():
    assert past_doors() == []


PARTS = {
    *("context", "gate", "navigator", "exploration"),
    *("search", "states", "returns", "airspace_update"),
}


def test_no_attribute_chain_reaches_into_the_controller():
    """What is `controller.gate.modes` inside is `controller.our_modes` for others."""
    reached = [
        f"{module}:{node.lineno}: {ast.unparse(node)}"
        for module, path in modules().items()
        if not module.startswith("air_router.controller")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in PARTS
        if ast.unparse(node.value).endswith("controller")
    ]
    assert reached == []


NARRATORS = (
    *("air_router.live", "air_router.web", "air_router.ros2"),
    *("air_router.report", "air_router.record"),
    *("air_router.flight.flight_line", "air_router.flight.flight_view"),
)
"""They show or record a flight."""

REPLAYS = {
    "air_router.live.playback": {"router", "status"},  # whose flight the page shows
    "air_router.record.replay": {"handle", "home_by", "reacts_within", "status"},
}
"""They run a recorded flight: a controller of their own decides again."""


def test_who_shows_a_flight_reads_its_status_and_nothing_else_of_the_controller():
    narrators = {
        module: ast.parse(path.read_text(encoding="utf-8"))
        for module, path in modules().items()
        if any(module == room or module.startswith(f"{room}.") for room in NARRATORS)
    }
    assert narrators.keys() >= REPLAYS.keys()
    imported, read = set(), dict[str, set[str]]()
    for module, tree in narrators.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and any(n.name == "Controller" for n in node.names):
                imported.add(module)
            if isinstance(node, ast.Attribute) and ast.unparse(node.value).endswith("controller"):
                read.setdefault(module, set()).add(node.attr)
    assert imported == REPLAYS.keys()
    assert read == REPLAYS


def test_every_room_has_a_door():
    """The root of a package has modules that are doors themselves."""
    rooms = [room for room in doors() if "." in room]
    assert [room for room in rooms if not hasattr(import_module(room), "__all__")] == []


def test_a_door_has_few_names():
    wide = {room for room, names in doors().items() if len(names) > NAMES}
    assert wide == {*MORE_NAMES}


def at_door(room: str, name: str) -> object:
    """What is had there; nothing where an extra is not installed."""
    try:
        return getattr(import_module(room), name)
    except ModuleNotFoundError as error:
        if str(error.name).split(".")[0] in ALLOWED:
            raise
        return None


@pytest.mark.parametrize("room", doors())
def test_a_door_has_what_it_names(room):
    """And no name is that of a module behind it: it would depend on what was imported before."""
    for name in doors()[room]:
        found = at_door(room, name)
        assert inspect.ismodule(found) == (f"{room}.{name}" in modules()), name


@pytest.mark.parametrize("room", [r for r in doors() if late_homes(modules()[r])])
def test_a_door_that_loads_late_gives_what_type_checkers_read(room):
    homes = late_homes(modules()[room])
    assert {*homes} == doors()[room]
    for name, home in homes.items():
        found = at_door(room, name)
        assert (
            found is None or inspect.ismodule(found) or found is getattr(import_module(home), name)
        )
