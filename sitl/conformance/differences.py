"""What differs among the versions of PX4, as tables: what a flight rests on, and every step."""

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from air_router.vehicle.px4 import FACTS, FLOWN, Version, VersionFact, name_of
from sitl.conformance.conversation import (
    BECAUSE,
    LEFT_OUT,
    Conversation,
    Step,
    conversations,
    in_version,
)
from sitl.px4sim import RECORDED

_NOTHING: Final = "no such step"


class Difference(NamedTuple):
    """One step that is otherwise in some versions than in 1.17.

    Attributes:
        conversation: Its name.
        versions: In which it is otherwise.
        usual: The step in 1.17, as text.
        other: The same in those versions.
        because: Where that is written, or why.
    """

    conversation: str
    versions: tuple[Version, ...]
    usual: str
    other: str
    because: str


def differences() -> Iterator[Difference]:
    """All of them, by conversation."""
    for one in conversations():
        if not one.is_held_with(RECORDED):
            versions = tuple(version for version in FLOWN if one.is_held_with(version))
            yield Difference(one.name, versions, "not run", one.fact, one.recorded)
        for step in one.steps:
            yield from _of_step(one, step)


def _of_step(one: Conversation, step: Step) -> Iterator[Difference]:
    usual = in_version(step, RECORDED)
    for text, versions in _grouped(step, usual):
        other = in_version(step, versions[0])
        whys = [
            str(value.get(BECAUSE) or value.get(LEFT_OUT))
            for value in step.values()
            if isinstance(value, dict)
            and (BECAUSE in value or LEFT_OUT in value)
            and _decides(step, value, versions[0])
        ]
        yield Difference(one.name, versions, _text(usual), text or _text(other), "; ".join(whys))


def _grouped(step: Step, usual: Step | None) -> Iterator[tuple[str, tuple[Version, ...]]]:
    """The versions in which a step is otherwise, those together in which it is the same."""
    found: dict[str, list[Version]] = {}
    for version in FLOWN:
        other = in_version(step, version)
        if other != usual:
            found.setdefault(_text(other), []).append(version)
    for text, versions in found.items():
        yield text, tuple(versions)


def _decides(step: Step, value: Any, version: Version) -> bool:
    """Whether one of a step's alternatives makes it what it is in a version, or in 1.17."""
    without = {key: each for key, each in step.items() if each is not value}
    return any(in_version(step, v) != in_version(without, v) for v in (version, RECORDED))


def _text(step: Step | None) -> str:
    if step is None:
        return _NOTHING
    (verb, about), *terms = step.items()
    listed = ", ".join(f"{name}: {_plain(value)}" for name, value in terms)
    return f"{verb} {_plain(about)}" + (f" ({listed})" if listed else "")


def _plain(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_plain, value))}]"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_plain(term)}" for name, term in value.items())
    return "none" if value is None else str(value)


def table_of_steps() -> str:
    """Every step that differs, as a table in Markdown."""
    rows = (
        (f"`{one.conversation}`", _named(one.versions), one.usual, one.other, one.because)
        for one in differences()
    )
    once = dict.fromkeys(rows)  # a step that is taken twice
    return _table(("conversation", "in", "step in 1.17", "there", "why"), tuple(once))


def table_of_facts() -> str:
    """What a flight rests on in which version, as a table in Markdown."""
    rows = [
        (fact.fact, _when(fact), fact.instead, fact.source, f"`{fact.conversation}`")
        for fact in FACTS
    ]
    return _table(("PX4", "in", "a flight", "where that is written", "conversation"), rows)


def _when(fact: VersionFact) -> str:
    return _named([version for version in FLOWN if fact.holds_in(version)])


def _named(versions: Sequence[Version]) -> str:
    return "all" if len(versions) == len(FLOWN) else ", ".join(map(name_of, versions))


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
