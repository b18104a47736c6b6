"""`python -m benchmarks.trunk [--json | --silent] [ROOT]`: complexity of the flight code.

Counted in the source of controller, flight, vehicle and routing, with their rooms:

* attributes of a class that are assigned after its construction, and the files that assign them. An
  assignment to `self` counts for its class, any other for the only class that declares an attribute
  of this name; if several do, for `MissionContext` if the target is named context. Growing lists
  are not detected.
* assignments to an attribute of anything but `self`: state written from outside.
* imports of another room's private modules.
* returns of the controller without the requested motion and without a reason, as
  `benchmarks.silence` defines them. `--silent` lists them.
* module constants outside `limits.py`, except those in `DEFINED`.

ROOT: measure another checkout. The exit code is always 0; limits are checked by tests.
"""

import argparse
import ast
import json
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeGuard

from benchmarks.silence import silences

ROOT = Path(__file__).parents[1]
ROOMS: Final = ("controller", "flight", "vehicle", "routing")
MANY: Final = 15
"""A class with more attributes that change is hard to know (docs/architecture.md)."""

DEFINED: Final = {
    "air_router/vehicle/px4/mavlink_values.py": "MAVLink, PX4 and Linux define them",
    "air_router/vehicle/airframe.py:PX4": "MAV_AUTOPILOT of MAVLink",
    "air_router/vehicle/vehicle.py:FIX_3D": "GPS_FIX_TYPE of MAVLink",
    "air_router/vehicle/px4/versions.py:FLOWN": "a fact: which versions were flown",
    "air_router/routing/router.py:_START": "stands for where the vehicle is, among nodes from 0 on",
}
"""Numbers that tune nothing, by `file` or `file:NAME`, and why: another would be a mistake."""

TAKES_SO: Final = {
    "configuration": "MAVSDK's, which takes what is not its default so",
}
"""What belongs to a library, and is set up by assignments."""

_BUILDERS: Final = frozenset({"__init__", "__post_init__", "__new__"})


class Assignment(NamedTuple):
    """One attribute that is assigned after construction.

    Attributes:
        file: Path from the root.
        holder: The class in which it is done; empty outside of any.
        target: What the attribute is of, as it is written: `self`, `self._context`.
        name: The attribute.
    """

    file: str
    holder: str
    target: str
    name: str


def files_of(root: Path) -> dict[str, ast.Module]:
    """The trunk's files, parsed, by their paths from the root."""
    return {
        str(path.relative_to(root)): ast.parse(path.read_text(encoding="utf-8"))
        for room in ROOMS
        for path in sorted((root / "air_router" / room).rglob("*.py"))
    }


def declared(trees: Mapping[str, ast.Module]) -> dict[str, set[str]]:
    """The attributes of each class that can be assigned; none of a frozen dataclass."""
    found: dict[str, set[str]] = defaultdict(set)
    for tree in trees.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not _is_frozen(node):
                found[node.name] |= {*_declared_in(node)}
    return found


def _is_frozen(node: ast.ClassDef) -> bool:
    text = " ".join(map(ast.unparse, (*node.decorator_list, *node.bases)))
    return "frozen=True" in text or "NamedTuple" in text or "Enum" in text


def _declared_in(node: ast.ClassDef) -> Iterator[str]:
    for each in ast.walk(node):
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
            yield each.target.id
        elif _is_set(each) and ast.unparse(each.value) == "self":
            yield each.attr


def _is_set(node: ast.AST) -> TypeGuard[ast.Attribute]:
    return isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)


def assignments(trees: Mapping[str, ast.Module]) -> list[Assignment]:
    """Each assignment to an attribute, but those that build an object."""
    return [found for path, tree in trees.items() for found in _assigned(path, "", tree)]


def _assigned(path: str, holder: str, node: ast.AST) -> Iterator[Assignment]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            yield from _assigned(path, child.name, child)
        elif isinstance(child, ast.FunctionDef) and child.name in _BUILDERS:
            continue
        else:
            if _is_set(child) and ast.unparse(child.value) not in TAKES_SO:
                yield Assignment(path, holder, ast.unparse(child.value), child.attr)
            yield from _assigned(path, holder, child)


def owner_of(found: Assignment, classes: Mapping[str, set[str]]) -> str:
    """The class whose attribute it is; empty where its name does not show it."""
    if found.target == "self":
        return found.holder
    owners = [name for name, names in classes.items() if found.name in names]
    if len(owners) > 1 and found.target.rpartition(".")[2].lstrip("_") == "context":
        owners = [name for name in owners if name == "MissionContext"]
    return owners[0] if len(owners) == 1 else ""


def numbers(trees: Mapping[str, ast.Module]) -> dict[str, int]:
    """How many numbers stand at the top of each file that is not called `limits.py`."""
    counts = {}
    for path, tree in trees.items():
        if path.endswith("/limits.py") or path in DEFINED:
            continue
        count = sum(f"{path}:{name}" not in DEFINED for name in _names_of_numbers(tree))
        if count:
            counts[path] = count
    return counts


def _names_of_numbers(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        match node:
            case (
                ast.Assign(targets=[target], value=value)
                | ast.AnnAssign(target=target, value=ast.expr() as value)
            ) if _is_number(value):
                yield ast.unparse(target)


def _is_number(node: ast.expr) -> bool:
    match node:
        case ast.Constant(value=value):
            return isinstance(value, int | float) and not isinstance(value, bool)
        case ast.UnaryOp(operand=operand):
            return _is_number(operand)
        case ast.BinOp(left=left, right=right):
            return _is_number(left) or _is_number(right)
        case ast.Tuple(elts=items):
            return bool(items) and all(map(_is_number, items))
    return False


def past_doors(root: Path) -> int:
    """How many names are imported from within another room."""
    rooms = {
        ".".join(path.parent.relative_to(root).parts)
        for package in ("air_router", "geo", "mocha_link", "sitl")
        for path in (root / package).rglob("__init__.py")
    }
    count = 0
    for room in rooms:
        for path in root.joinpath(*room.split(".")).glob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.module:
                    there = node.module.rpartition(".")[0]
                    inside = node.module not in rooms and there in rooms and "." in there
                    count += len(node.names) * (inside and there != room)
    return count


def measured(root: Path) -> dict[str, Any]:
    """All of it, of one checkout."""
    trees = files_of(root)
    classes, found = declared(trees), assignments(trees)
    written: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for each in found:
        written[owner_of(each, classes)][each.name].add(each.file)
    written.pop("", None)
    return {
        "classes": {
            name: {
                "attributes": len(names),
                "several_writers": sum(len(files) > 1 for files in names.values()),
                "files": len(set().union(*names.values())),
            }
            for name, names in written.items()
        },
        "assigned_from_outside": sum(each.target != "self" for each in found),
        "names_past_doors": past_doors(root),
        "numbers": numbers(trees),
        "silent_returns": [
            f"{each.file}:{each.line} {each.function}" for each in silences(_controller(trees))
        ],
    }


def _controller(trees: Mapping[str, ast.Module]) -> dict[str, ast.Module]:
    return {path: tree for path, tree in trees.items() if "/controller/" in path}


def main() -> int:
    """Print it; see the module's docstring."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.trunk", description="Measure the complexity of the flight code."
    )
    parser.add_argument("root", nargs="?", type=Path, default=ROOT, metavar="ROOT", help="checkout")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--silent", action="store_true", help="list the silent returns")
    arguments = parser.parse_args()
    result = measured(arguments.root.resolve())
    if arguments.json:
        print(json.dumps(result))
        return 0
    if arguments.silent:
        print("\n".join(result["silent_returns"]))
        return 0
    classes, counts = result["classes"], result["numbers"]
    print(f"{'class':24} {'attributes that change':>22} {'of several files':>16} {'files':>5}")
    for name, row in sorted(classes.items(), key=lambda item: -item[1]["attributes"]):
        if row["attributes"] > MANY or row["several_writers"]:
            print(f"{name:24} {row['attributes']:22} {row['several_writers']:16} {row['files']:5}")
    over = sum(row["attributes"] > MANY for row in classes.values())
    print(f"classes: {len(classes)}, of them with more than {MANY}: {over}")
    print(f"assignments to an attribute of anything but self: {result['assigned_from_outside']}")
    print(f"names imported past a door: {result['names_past_doors']}")
    print(f"numbers outside limits.py: {sum(counts.values())} in {len(counts)} files")
    print(f"silent returns of a wanted motion: {len(result['silent_returns'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
