"""The ways to get messages across, each behind the same port."""

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from benchmarks.link.offer import Offer

ADDRESSES = ("10.213.0.1", "10.213.0.2")  # of the node that has messages, of the one that wants
Deliver = Callable[[int], None]
ENDED = -1  # delivered instead of a message: the two know that they have exchanged everything


class Side(Protocol):
    """One of the two nodes, in a process and a network namespace of its own."""

    def start(self) -> None:
        """Get ready; there is no contact yet."""

    def signal_received(self, *, again: bool) -> None:
        """The radio receives the other one: a contact begins, or (`again`) goes on."""

    def lost(self) -> None:
        """The radio does not receive the other one any more."""

    def close(self) -> None:
        """Stop; what was delivered stays readable."""

    def data(self, key: int) -> bytes | None:
        """A message that was delivered, as it arrived (called on the wanting side only)."""


@dataclass(frozen=True, slots=True)
class Way:
    """A way: its name, what it is, where its two sides are, which packages it needs.

    Attributes:
        usual: it is run unless others are named.
    """

    name: str
    what: str
    source: str
    sink: str
    needs: str | None = None
    usual: bool = True

    @property
    def missing(self) -> str | None:
        """The package that is not installed, if any."""
        needs = self.needs
        return needs if needs and importlib.util.find_spec(needs) is None else None

    def make_source(self, offer: Offer) -> Side:
        side: Side = _load(self.source)(offer)
        return side

    def make_sink(self, offer: Offer, deliver: Deliver) -> Side:
        """The side that wants the messages; calls `deliver` for each, from any thread."""
        side: Side = _load(self.sink)(offer, deliver)
        return side


def _load(name: str) -> Callable[..., Side]:
    module, _, attribute = name.partition(":")
    found: Callable[..., Side] = getattr(importlib.import_module(module), attribute)
    return found


_HERE = "benchmarks.link.ways"
WAYS = {
    way.name: way
    for way in (
        Way(
            "original",
            "one request at a time, each on a new socket: what the original nodes do",
            f"{_HERE}.original:OriginalSource",
            f"{_HERE}.original:OriginalSink",
        ),
        Way(
            "old-peer",
            "our node pulls from an original one",
            f"{_HERE}.original:OriginalSource",
            f"{_HERE}.node:NodeSink",
        ),
        Way(
            "new",
            "our node pulls from our node",
            f"{_HERE}.node:NodeSource",
            f"{_HERE}.node:NodeSink",
        ),
        Way(
            "new-tcp",
            "the same without datagrams",
            f"{_HERE}.node:TcpNodeSource",
            f"{_HERE}.node:TcpNodeSink",
            usual=False,
        ),
        Way(
            "tcp",
            "a stream on a new TCP connection per contact, resumed where it was cut",
            f"{_HERE}.tcp:TcpSource",
            f"{_HERE}.tcp:TcpSink",
        ),
        Way(
            "zenoh",
            "a new eclipse-zenoh session per contact and one get of what is missing",
            f"{_HERE}.zenoh:ZenohSource",
            f"{_HERE}.zenoh:ZenohSink",
            needs="zenoh",
        ),
        Way(
            "cyclonedds",
            "a reliable, transient-local topic with a key per message",
            f"{_HERE}.dds:DdsSource",
            f"{_HERE}.dds:DdsSink",
            needs="cyclonedds",
        ),
    )
}
