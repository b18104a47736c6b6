"""One pull on its way over the channel: what is to cross it next, what that costs, what came of it.

The frames are those of `mocha_link`. What a transmission is made of follows from the protocol:

original  A request and its reply cross together: GHEAD is a header request, each GDATA a piece of
          data, DENDT the end. One at a time.
ours      The opening of a sync, and whatever else has to go back and forth before data flow, is a
          header request; the other side's reply rides along. Frames of data follow without
          further requests. Credit, what may be skipped, and the end need no turn of their own: no
          robot waits for an answer to them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mocha_link.node import Gossip
from mocha_link.store import Header
from mocha_link.sync import (
    ACK,
    ANSWER,
    CODE_BYTES,
    DENDT,
    GDATA,
    GHEAD,
    ID_BYTES,
    OPEN,
    SYNC1,
    SYNCF,
    Frame,
    read_chunks,
)
from sitl.experiment.engine.channel import Link, Load, Stage

_STAGES: Final = {GHEAD: Stage.HEADER, GDATA: Stage.DATA, DENDT: Stage.END}
_BODY: Final = ID_BYTES + CODE_BYTES

_REQUEST_TRIPS: Final = 4
"""Round trips of a request of an original node: it makes a new connection for each (measured)."""

_OPENING_TRIPS: Final = 2
"""Round trips until our node has its first reply on a new connection (docs/protocol.md)."""


class Transmission(NamedTuple):
    """A transmission. What was interrupted and sent again has one for each try.

    Attributes:
        ready_s: When it could have begun, had the channel been free; of each try the same.
        start_s: When it began.
        end_s: When it arrived, or was interrupted.
        requesting: Number of the robot that pulls.
        answering: Of whom it pulls from.
        stage: A `Stage`.
        messages: Robots' messages that arrived with it.
        bytes: Request and replies; of an interrupted one as far as it came.
        complete: It was not interrupted.
    """

    ready_s: float
    start_s: float
    end_s: float
    requesting: int
    answering: int
    stage: int
    messages: int
    bytes: int
    complete: bool


class ContactInterval(NamedTuple):
    """Two robots, by their numbers, were in contact; one that lasts ends with the run."""

    began_s: float
    ended_s: float
    a: int
    b: int


Turn = tuple[tuple[float, ...], int]
"""A place among those that wait, the least is next: by the channel's model, then as they came."""


@dataclass(slots=True, eq=False)
class Exchange:
    """A pull from its beginning to its end.

    Attributes:
        link: Who pulls from whom.
        route: By what the answering node knows the connection.
        requests: Requests that have not crossed yet, in their order.
        supplied: Frames of data that are under way to the requesting node.
        load: What is on the air, or was when contact was lost.
        ready_s: Since when it is its turn but for the channel; None: it has nothing to send.
        start_s: When it began to send; None: it does not.
        end_s: When that will have arrived.
        turn: Its place among those that wait; None: it does not.
        opened: It is one of ours, and its opening has arrived.
        dry: The answering node has no more frames until it receives something.
        parting: Which loss of contact it has not recovered from; 0: none.
        again: Contact began anew meanwhile: pull again at the end.
        over: It has come to its end.
    """

    link: Link
    route: tuple[bytes, ...]
    requests: deque[bytes] = field(default_factory=deque)
    supplied: list[Sequence[Frame]] = field(default_factory=list)
    load: Load | None = None
    ready_s: float | None = None
    start_s: float | None = None
    end_s: float = 0.0
    turn: Turn | None = None
    opened: bool = False
    dry: bool = False
    parting: int = 0
    again: bool = False
    over: bool = False


def code_of(request: bytes) -> bytes:
    """The five letters that name the kind of a request."""
    return request[ID_BYTES:_BODY]


def needs_turn(request: bytes) -> bool:
    """Whether a request waits for the channel, or goes along with others."""
    code = code_of(request)
    if code == SYNCF:
        return request[_BODY] in (OPEN, ANSWER)
    return code == SYNC1 or code in _STAGES


def stage_of(request: bytes) -> Stage:
    """What a request that needs a turn is for."""
    return _STAGES.get(code_of(request), Stage.HEADER)


def request_load(exchange: Exchange, answering: Gossip) -> Load:
    """What the next request of an exchange sends, with what answers it as things stand."""
    request = exchange.requests[0]
    if code_of(request) == SYNC1 or exchange.opened:
        return Load(Stage.HEADER, 0, sum(map(len, exchange.requests)), _OPENING_TRIPS)
    stage, size = stage_of(request), len(request) + ID_BYTES
    match stage:
        case Stage.HEADER:
            size += len(answering.database.header_list())
        case Stage.DATA:
            record = answering.database.get(Header.parse(request[_BODY:]))
            size += len(record.body) if record else 0
        case Stage.END:
            size += len(ACK)
    return Load(stage, int(stage is Stage.DATA), size, _REQUEST_TRIPS)


def finished_in(parts: Sequence[Frame]) -> int:
    """How many messages are whole once this frame of data has arrived."""
    chunks = read_chunks(memoryview(parts[0])[ID_BYTES:], parts[1:])
    ends = sum(offset + len(data) == total for _, total, offset, data in chunks.pieces)
    return len(chunks.wholes) + ends


class AirtimeStats:
    """Notes transmissions, contacts and pulls.

    Args:
        on_end: Takes every transmission as it ends, for the event log.

    Attributes:
        complete: Pulls that came to their end.
        broken: Pulls that were given up when contact was lost.
        transmissions: In the order of their ends.
        contacts: Those that are over.
    """

    def __init__(self, on_end: Callable[[Transmission], None]) -> None:
        self.complete = self.broken = 0
        self.transmissions: list[Transmission] = []
        self.contacts: list[ContactInterval] = []
        self._on_end = on_end

    def sent(self, exchange: Exchange, end_s: float, part: float | None = None) -> None:
        """A transmission of an exchange ends; `part`: it was cut, and so much of it had crossed."""
        load, start_s, ready_s = exchange.load, exchange.start_s, exchange.ready_s
        if load is None or start_s is None or ready_s is None:
            raise AssertionError("a transmission begins before it ends")
        sent = Transmission(
            round(ready_s, 6),
            round(start_s, 6),
            round(end_s, 6),
            *exchange.link,
            int(load.stage),
            load.messages if part is None else 0,
            load.size if part is None else int(load.size * part),
            complete=part is None,
        )
        self.transmissions.append(sent)
        self._on_end(sent)
