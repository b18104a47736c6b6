"""What a new team file changes, and what that cuts while some nodes still have the old one.

Each change is judged as between a node that has the old file and one that has the new file. Once
all have the new file, and were restarted, none of it matters.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from mocha_link.team import Robot, Team, Topic, Trust, UnknownRobotError, keys

_TOPIC = ("name", "type", "dtype", "topic_id", "aggregate")
_OWN_TOPIC = ("priority", "min_interval_s", "history")
_OWN_ROBOT = ("listen", "radio", "radio_id", "datum")
_SHORT = 40  # letters of a value that are shown


@dataclass(frozen=True, slots=True)
class Change:
    """One difference of two team files.

    Attributes:
        subject: what differs: ``topic rover /pose``, ``robot io``, ``link io - titan`` ...
        key: the key of the team file, or what follows from it (``id``, ``port``); empty: all of it.
        old: its value, as text; empty: it is not there.
        new: likewise.
        cuts: whether nodes with different files exchange less, as long as they differ.
        effect: what that is, for the operator.
    """

    subject: str
    key: str
    old: str
    new: str
    cuts: bool
    effect: str

    def __str__(self) -> str:
        what = f"{self.key}: " if self.key else ""
        values = (
            f"{self.old or 'none'} -> {self.new or 'none'}" if self.key else self.old or self.new
        )
        return f"{self.subject}: {what}{values}; {self.effect}"

    def as_json(self) -> dict[str, Any]:
        """What ``--json`` prints of it."""
        return asdict(self)


def changes(old: Team, new: Team) -> list[Change]:
    """The differences of two team files, those that cut the exchange first."""
    found = [
        *_robots(old, new),
        *_topics(old, new),
        *_links(old, new),
        *_trust(old, new),
        *_trigger(old, new),
        *_message_texts(old, new),
    ]
    return sorted(found, key=lambda change: not change.cuts)


def _text(value: object) -> str:
    text = "" if value is None else str(getattr(value, "name", value)).strip()
    text = text.lower() if isinstance(value, bool | Trust) else text
    return text if len(text) <= _SHORT else text[: _SHORT - 3] + "..."


def _robots(old: Team, new: Team) -> Iterator[Change]:
    for name in sorted(old.robots.keys() | new.robots.keys()):
        subject = f"robot {name}"
        before, after = old.robots.get(name), new.robots.get(name)
        if before is None:
            effect = "nodes with the old file neither take nor relay its messages"
            yield Change(subject, "", "", "added", cuts=True, effect=effect)
        elif after is None:
            effect = "nodes with the new file neither take nor relay its messages"
            yield Change(subject, "", "removed", "", cuts=True, effect=effect)
        else:
            yield from _robot(subject, before, after)


def _robot(subject: str, before: Robot, after: Robot) -> Iterator[Change]:
    if before.robot_id != after.robot_id:
        ids = str(before.robot_id), str(after.robot_id)
        effect = "its messages are not taken by nodes with the other file"
        yield Change(subject, "id", *ids, cuts=True, effect=effect)
    for key in ("kind", "ros"):
        values = _text(getattr(before, key)), _text(getattr(after, key))
        if values[0] != values[1]:
            effect = "its messages mean something else in the other file"
            yield Change(subject, key, *values, cuts=True, effect=effect)
    if before.original != after.original:
        values = _text(before.original), _text(after.original)
        effect = "nodes with either file still exchange with it, by the protocol of original nodes"
        yield Change(subject, "original", *values, cuts=False, effect=effect)
    for key in _OWN_ROBOT:
        values = _text(getattr(before, key)), _text(getattr(after, key))
        if getattr(before, key) != getattr(after, key):
            effect = "each node goes by its own file"
            yield Change(subject, key, *values, cuts=False, effect=effect)


def _topics(old: Team, new: Team) -> Iterator[Change]:
    for kind in sorted(old.kinds.keys() | new.kinds.keys()):
        before = {topic.name: topic for topic in old.kinds.get(kind, ())}
        after = {topic.name: topic for topic in new.kinds.get(kind, ())}
        for name in dict.fromkeys((*before, *after)):
            subject = f"topic {kind} {name}"
            if name not in before:
                effect = "nodes with the old file do not take it"
                yield Change(subject, "", "", "added", cuts=True, effect=effect)
            elif name not in after:
                effect = "nodes with the new file do not take it"
                yield Change(subject, "", "removed", "", cuts=True, effect=effect)
            else:
                yield from _topic(subject, before[name], after[name])


def _topic(subject: str, before: Topic, after: Topic) -> Iterator[Change]:
    names = {"dtype": "type id", "topic_id": "id"}
    for key in (*_TOPIC, *_OWN_TOPIC):
        if getattr(before, key) == getattr(after, key):
            continue
        if key == "dtype" and before.type != after.type:
            continue  # that follows
        cuts = key in _TOPIC
        effect = "nodes with different files do not exchange it"
        if not cuts:
            effect = "each node goes by its own file"
        values = _text(getattr(before, key)), _text(getattr(after, key))
        yield Change(subject, names.get(key, key), *values, cuts=cuts, effect=effect)


def _pairs(team: Team) -> set[tuple[str, str]]:
    return {
        (name, peer) for name, robot in team.robots.items() for peer in robot.peers if name < peer
    }


def _links(old: Team, new: Team) -> Iterator[Change]:
    before, after = _pairs(old), _pairs(new)
    for pair in sorted(before | after):
        subject = f"link {' - '.join(pair)}"
        if pair not in before:
            effect = "it begins when both have the new file"
            yield Change(subject, "", "", "added", cuts=False, effect=effect)
        elif pair not in after:
            effect = "nodes with the new file have no port for it"
            yield Change(subject, "", "removed", "", cuts=True, effect=effect)
        else:
            yield from _places(subject, old, new, pair)
            yield from _keys(subject, old, new, pair)


def _places(subject: str, old: Team, new: Team, pair: tuple[str, str]) -> Iterator[Change]:
    """Where each of two robots is dialed. While one of both is found, a connection stands."""
    moved = [
        (name, _place(old, name, peer), _place(new, name, peer))
        for name, peer in (pair, pair[::-1])
        if _place(old, name, peer) != _place(new, name, peer)
    ]
    originals = [name for name in pair if new.robot(name).original or old.robot(name).original]
    for name, was, will_be in moved:
        other = pair[0] if name == pair[1] else pair[1]
        if len(moved) == len(pair):
            cuts, effect = True, "nodes with different files do not find each other"
        elif originals:
            cuts, effect = True, f"the original node of {originals[0]} needs both ways"
        else:
            cuts = False
            effect = f"until both have the new file, only {name} finds {other}, not the reverse"
        yield Change(subject, f"where {name} is dialed", was, will_be, cuts=cuts, effect=effect)


def _place(team: Team, name: str, peer: str) -> str:
    robot = team.robot(name)
    return f"{robot.shown_address}, port {robot.port_for(peer)}"


def _keys(subject: str, old: Team, new: Team, pair: tuple[str, str]) -> Iterator[Change]:
    def shown(team: Team) -> str:
        first, second = map(team.robot, pair)
        if keys.open_because(first, second):
            return "none"
        return ", ".join(f"{robot.name} {(robot.key or '')[:8]}..." for robot in (first, second))

    def used(team: Team) -> tuple[str | None, ...] | None:
        first, second = map(team.robot, pair)
        return None if keys.open_because(first, second) else (first.key, second.key)

    if used(old) != used(new):
        effect = "nodes with different files refuse each other's connections"
        yield Change(subject, "keys", shown(old), shown(new), cuts=True, effect=effect)


def _trust(old: Team, new: Team) -> Iterator[Change]:
    if old.trust is new.trust:
        return
    values = old.trust.value, new.trust.value
    if new.trust is Trust.RELAYS:
        effect = "each node goes by its own file"
        yield Change("team", "trust", *values, cuts=False, effect=effect)
        return
    unsigned = [name for name in new.robots if not _has_key(old, name)]
    effect = "all robots signed their messages before"
    if unsigned:
        effect = (
            "nodes with the new file refuse messages without a signature: those of "
            f"{', '.join(unsigned)} from relays, or from nodes with the old file"
        )
    yield Change("team", "trust", *values, cuts=bool(unsigned), effect=effect)


def _has_key(team: Team, name: str) -> bool:
    try:
        return team.robot(name).key is not None
    except UnknownRobotError:
        return False


def _trigger(old: Team, new: Team) -> Iterator[Change]:
    for key, before in old.trigger:
        after = getattr(new.trigger, key)
        if before != after:
            values = _text(before), _text(after)
            effect = "each node goes by its own file"
            yield Change("trigger", key, *values, cuts=False, effect=effect)


def _message_texts(old: Team, new: Team) -> Iterator[Change]:
    for name in sorted(old.definitions.keys() | new.definitions.keys()):
        values = old.definitions.get(name, ""), new.definitions.get(name, "")
        if values[0] != values[1]:
            effect = "each node decodes by its own file"
            shown = _text(values[0]), _text(values[1])
            yield Change("definitions", name, *shown, cuts=False, effect=effect)
