"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours.

team = Team.load(Path("team.yaml"))
with Node(team, "titan") as node:
    node.subscribe(print)
    node.publish("/pose", b"...")
"""

import re
from importlib import import_module
from pathlib import Path

__version__ = "0.2.0.dev0"

_MODULES = {
    name: module
    for module, name in re.findall(
        r"^from (\S+) import (\w+) as ",
        Path(__file__).with_suffix(".pyi").read_text("utf-8"),
        re.MULTILINE,
    )
}
"""Which module has what, as `__init__.pyi` says to type checkers. It is imported when one of its
names is asked for, so that a program that needs only a part, as most commands do, does not wait for
numpy, pydantic and sockets.
"""

__all__ = sorted(_MODULES)  # noqa: PLE0605 - a list, computed from one table


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_MODULES[name]), name)
    globals()[name] = found  # the next time it is there
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
