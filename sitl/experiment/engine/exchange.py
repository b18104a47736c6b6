"""One pull on its way over the channel: what is to cross it next, and what that costs.

The frames are those of `mocha_link`: nothing here says anything of its own. What a transmission is
made of follows from the protocol that the two nodes speak:

original  A request and its reply cross together: GHEAD is a header request, each GDATA a piece of
          data, DENDT the end. One at a time.
ours      The opening of a sync, and whatever else has to go back and forth before data flow (a new
          opening, answers to group digests), is a header request; what the other side says to it
          rides along. Frames of data follow one another without further requests; what they bring
          whole is the data of the transmission. Credit, what may be skipped, and the end need no
          turn of their own: no robot waits for an answer to them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from mocha_link.sync.frames import ANSWER, CHUNKS, OPEN, Frame, read_chunks
from mocha_link.sync.protocol import CODE_BYTES, DENDT, GDATA, GHEAD, ID_BYTES, SYNC1, SYNCF
from sitl.experiment.channels.channel import Link, Load, Stage

_STAGES: Final = {GHEAD: Stage.HEADER, GDATA: Stage.DATA, DENDT: Stage.END}
_BODY: Final = ID_BYTES + CODE_BYTES


@dataclass(slots=True, eq=False)
class Exchange:
    """A pull from its beginning to its end.

    Attributes:
        link: Who pulls from whom.
        route: By what the answering node knows the connection.
        asked: Requests that have not crossed yet, in their order.
        supplied: Frames of data that are under way to the asking node.
        load: What is on the air, or was when contact was lost.
        ready_s: Since when it is its turn but for the channel; None: it has nothing to send.
        start_s: When it began to send; None: it does not.
        end_s: When that will have arrived.
        turn: Its place among those that wait; None: it does not.
        opened: It is one of ours, and its opening has arrived.
        dry: The answering node has no more frames until it hears something.
        parting: Which loss of contact it has not recovered from; 0: none.
        again: Contact began anew meanwhile: pull again at the end.
        over: It has come to its end.
    """

    link: Link
    route: tuple[bytes, ...]
    asked: deque[bytes] = field(default_factory=deque)
    supplied: list[Sequence[Frame]] = field(default_factory=list)
    load: Load | None = None
    ready_s: float | None = None
    start_s: float | None = None
    end_s: float = 0.0
    turn: tuple[tuple[float, ...], int] | None = None
    opened: bool = False
    dry: bool = False
    parting: int = 0
    again: bool = False
    over: bool = False


def code_of(request: bytes) -> bytes:
    """The five letters that say what a request is."""
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


def is_data(parts: Sequence[Frame]) -> bool:
    """Whether a supplied frame, behind its id, has data in it."""
    return parts[0][ID_BYTES] == CHUNKS


def finished_in(parts: Sequence[Frame]) -> int:
    """How many messages are whole once this frame of data has arrived."""
    chunks = read_chunks(memoryview(parts[0])[ID_BYTES:], parts[1:])
    ends = sum(offset + size == total for _, total, offset, size in chunks.pieces)
    return len(chunks.wholes) + ends


def size_of(parts: Sequence[Frame]) -> int:
    """Bytes of a frame."""
    return sum(map(len, parts))
