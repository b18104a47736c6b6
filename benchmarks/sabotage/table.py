"""The sabotages of the texts beside this: one place of the flight code each.

`=` begins one with its name, `?` lists its scenes, `@` names a file; then, as in a patch, `-` is
the text that stands there in one place, and `+` what stands there instead.
"""

from itertools import groupby
from pathlib import Path
from typing import Final, NamedTuple

from benchmarks.patched import Change


class Sabotage(NamedTuple):
    """A way to break the flight code.

    Attributes:
        name: What is broken, as text.
        scenes: What is flown with it, as `FAULT-seed`, in order, until the judge finds one bad.
        changes: Where.
    """

    name: str
    scenes: tuple[str, ...]
    changes: tuple[Change, ...]


def parse(text: str) -> tuple[Sabotage, ...]:
    """The sabotages that a text describes."""
    found = []
    for entry in ("\n" + text).split("\n= ")[1:]:
        name, *lines = entry.splitlines()
        scenes: list[str] = []
        changes: list[Change] = []
        module = ""
        for mark, run in groupby(lines, key=lambda line: line[:1]):
            texts = [line[1:] for line in run]
            if mark == "?":
                scenes = " ".join(texts).split()
            elif mark == "@":
                module = texts[0].strip().removesuffix(".py").replace("/", ".")
            elif mark == "-":
                changes.append(Change(module, "\n".join(texts), ""))
            elif mark == "+":
                changes[-1] = changes[-1]._replace(new="\n".join(texts))
        found.append(Sabotage(name, tuple(scenes), tuple(changes)))
    return tuple(found)


SABOTAGES: Final = tuple(
    sabotage
    for path in sorted(Path(__file__).parent.glob("*.txt"), reverse=True)
    for sabotage in parse(path.read_text(encoding="utf-8"))
)
