"""What `adapter` is for controllers, for gossip nodes: their names of today, and how to tap them.

A node's stream is every call of its pure core, and what that wants sent and tells of, bytes and
all. What it draws at random is the same number every time.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from mocha_link.clock import Instant
from mocha_link.node.gossip import Gossip
from mocha_link.sync import protocol as actions
from mocha_link.team.document import Document
from mocha_link.team.team import Team, Topic
from tests.golden import adapter
from tests.golden.plain import Tape, Tongue

CALLS = {  # word: method, arguments
    "publish": ("publish", ("topic", "data")),
    "signal": ("signal_received", ("peer", "reading")),
    "pull": ("sync", ("peer",)),
    "request": ("request", ("peer", "route", "parts")),
    "supply": ("supply", ("peer",)),
    "reply": ("reply", ("peer", "parts")),
    "datagram": ("packet_in", ("peer", "packet")),
    "datagram_back": ("packet_back", ("peer", "packet")),
    "connected": ("progress", ("peer",)),
    "lost": ("lost", ("peer", "reason")),
    "tick": ("tick", ()),
}
TIMELESS = {"supply"}
"""Calls that do not pass the time."""

WANTED = {
    "dial": (actions.Connect, "peer"),
    "send": (actions.Send, "peer frame"),
    "hang_up": (actions.Disconnect, "peer at_once=void"),
    "reply": (actions.Reply, "peer route frame"),
    "send_datagram": (actions.SendDatagram, "peer packet"),
    "reply_datagram": (actions.ReplyDatagram, "peer packet"),
}
_TONGUE = Tongue((adapter.EVENTS, adapter.PARTS, WANTED), adapter.WORDS, adapter.Point)


@contextmanager
def _numbers_of(number: int) -> Iterator[None]:
    """Random numbers that are none: in whatever order a node draws, it gets its own number."""
    with (
        patch("os.urandom", lambda size: bytes((number,)) * size),
        patch("secrets.randbits", lambda bits: (0x5EED0 + number) % (1 << bits)),
    ):
        yield


class Node:
    """A node's core whose calls, and what comes of them, are plain data."""

    reaction_s = None

    def __init__(self, setup: Mapping[str, Any]) -> None:
        self._team = Team.from_document(Document.from_text(setup["team"], Path("team.yaml")))
        self._name = setup["name"]
        self._unix_s = setup["unix_s"]
        self._number = setup["number"]
        with _numbers_of(self._number):
            own = {**setup["options"], "new_id": ids_of(self._number)}
            self._gossip = Gossip(self._team, self._name, **own)

    def decide(self, now_s: float, call: Mapping[str, Any]) -> list[Any]:
        """What comes of a call: its answer, what is to be done, and events."""
        with _numbers_of(self._number):
            answer = self._call(now_s, call)
            wanted, events = self._gossip.take()
        answers = []
        if answer is not None and call["kind"] != "tick":  # which says whom to `supply` now
            answers = [{"kind": "answer", "value": _TONGUE.plain_of(answer)}]
        return answers + [_TONGUE.plain_of(each) for each in (*wanted, *events)]

    def _call(self, now_s: float, call: Mapping[str, Any]) -> Any:
        method, names = CALLS[call["kind"]]
        values = [_TONGUE.object_of(call[name]) for name in names]
        if call["kind"] == "publish":
            values[0] = self._team.topic(self._name, call["topic"])
        if call["kind"] not in TIMELESS:
            values.append(Instant(self._unix_s + now_s, now_s))
        return getattr(self._gossip, method)(*values)


def ids_of(node: int) -> Callable[[], bytes]:
    """Names for a node's requests."""
    numbers = itertools.count(1)
    return lambda: node.to_bytes(2) + next(numbers).to_bytes(4)


@contextmanager
def tapped(team: str, unix_s: float) -> Iterator[list[Tape]]:
    """Listen to every node that is made meanwhile; steady time 0 is at `unix_s`."""
    tapes: list[Tape] = []
    taps: dict[int, Tape] = {}
    within: list[str] = []  # a node calls some of these itself
    make = Gossip.__init__

    def made(self: Gossip, of: Team, name: str, **options: Any) -> None:
        number = len(tapes) + 1
        with _numbers_of(number):
            make(self, of, name, **{**options, "new_id": ids_of(number)})
        plain = {key: value for key, value in options.items() if key != "new_id"}
        setup = {"team": team, "name": name, "unix_s": unix_s, "number": number, "options": plain}
        taps[id(self)] = Tape(setup, [])
        tapes.append(taps[id(self)])

    def listener(word: str) -> Callable[..., Any]:
        method, names = CALLS[word]
        call = getattr(Gossip, method)

        def called(self: Gossip, *values: Any) -> Any:
            if within:
                return call(self, *values)
            parts = {name: _plain(value) for name, value in zip(names, values, strict=False)}
            setup, steps = taps[id(self)]
            within.append(word)
            with _numbers_of(setup["number"]):
                answer = call(self, *values)
            within.pop()
            if word not in TIMELESS:
                steps.append((round(values[-1].steady_s, 6), None, {"kind": word, **parts}, []))
            elif answer is not None:  # it is called again and again
                steps.append((steps[-1][0], None, {"kind": word, **parts}, []))
            return answer

        return called

    listeners = {method: listener(word) for word, (method, _) in CALLS.items()}
    with patch.multiple(Gossip, __init__=made, **listeners):
        yield tapes


def _plain(value: Any) -> Any:
    return value.name if isinstance(value, Topic) else _TONGUE.plain_of(value)
