"""Runs a module of Python with places of our source changed, without touching a file.

python -m benchmarks.patched '[["geo.airspace.zone", "_NEAR_M = 1.5", "X"]]' pytest ARGS

What `benchmarks.mutants` and `benchmarks.sabotage` stand on: a change that does not apply to
exactly one place of its module is an error, so that no list of changes outlives its code.
"""

import builtins
import json
import runpy
import symtable
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Change(NamedTuple):
    """One place of one module: the text that stands there, and what stands there instead."""

    module: str
    old: str
    new: str


class ChangeError(Exception):
    """A change that is about no place of its module, or about several."""


def changed(source: str, change: Change) -> str:
    """The source with the change. Raises ChangeError."""
    count = source.count(change.old)
    if count != 1:
        raise ChangeError(f"{change.module} has {change.old!r} in {count} places, not in one")
    return source.replace(change.old, change.new)


def undefined(source: str) -> set[str]:
    """The names that the functions of a module use, and that nothing defines.

    Raises:
        SyntaxError: it is no Python.
    """
    module = symtable.symtable(source, "source", "exec")
    known = {*vars(builtins), "__file__", "__name__"}
    for each in module.get_symbols():
        if each.is_assigned() or each.is_imported() or each.is_namespace():
            known.add(each.get_name())
    tables, found = [module], set[str]()
    while tables:
        table = tables.pop()
        tables += table.get_children()
        found |= {each.get_name() for each in table.get_symbols() if each.is_global()}
    return found - known


def check(changes: Sequence[Change]) -> None:
    """Raise ChangeError unless each change applies to the source as it stands; it stays Python."""
    for change in changes:
        path = ROOT.joinpath(*change.module.split(".")).with_suffix(".py")
        if not path.exists():
            raise ChangeError(f"there is no module {change.module}")
        source = changed(path.read_text(encoding="utf-8"), change)
        where = f"{change.module} with {change.new!r}"
        try:
            unknown = undefined(source)
        except SyntaxError as error:
            raise ChangeError(f"{where} is no Python: {error}") from None
        if unknown:  # it would only end in a NameError
            raise ChangeError(f"{where} uses {', '.join(sorted(unknown))}, defined nowhere")


def install(changes: Sequence[Change]) -> None:
    """Have modules that are imported from now on changed."""
    check(changes)
    for change in changes:
        if change.module in sys.modules:
            raise ChangeError(f"{change.module} was imported before")
    sys.meta_path.insert(0, _Finder(changes))


class _Finder(MetaPathFinder):
    def __init__(self, changes: Sequence[Change]) -> None:
        self._changes = changes

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None = None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        mine = [change for change in self._changes if change.module == fullname]
        spec = PathFinder.find_spec(fullname, path, target) if mine else None
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin, mine)
        return spec


class _Loader(SourceFileLoader):
    def __init__(self, fullname: str, path: str, changes: Sequence[Change]) -> None:
        super().__init__(fullname, path)
        self._changes = changes

    def get_code(self, fullname: str) -> CodeType:
        source = Path(self.path).read_text(encoding="utf-8")
        for change in self._changes:
            source = changed(source, change)
        return compile(source, self.path, "exec", dont_inherit=True)


if __name__ == "__main__":
    install([Change(*change) for change in json.loads(sys.argv[1])])
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
