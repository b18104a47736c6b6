"""A stand-in for an original node: what it answers, requests, stores and hands on, faults included.

It follows what was seen of the original nodes on the wire, not their code: one REP socket per
peer, one REQ socket per request, requests one after another, the newest header of every topic by
its own idea of new, and nothing checked. Times are injected; time-outs are short.
"""

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

import lz4.frame
import zmq

from mocha_link.team.team import Team

ID, CODE, HEADER = 6, 5, 6
WRAP_S = 65536
STOPS_AT_S = 1.0  # a topic whose newest message is not later than this locks its database for good
SILENT = b"silent"  # what an `override` returns for no answer at all
JUNK = b"SERRM"  # the error reply, which its own kind keeps as a message


def header(robot_id: int, topic_id: int, unix_s: float) -> bytes:
    """The six bytes that an original node makes of a message's time."""
    ms = round(unix_s * 1000)
    seconds = (ms // 1000) % WRAP_S
    return bytes([robot_id, topic_id]) + seconds.to_bytes(2) + (ms % 1000).to_bytes(2)


def wire_s(raw: bytes) -> float:
    """The time in a header as an original node reads it: modulo 65536 s."""
    return int.from_bytes(raw[2:4]) + int.from_bytes(raw[4:6]) / 1000


def packed(dtype: int, priority: int, data: bytes) -> bytes:
    """The body of a message."""
    return bytes((dtype, priority)) + lz4.frame.compress(data)


def split(headers: bytes) -> list[bytes]:
    """A list of headers, one by one."""
    return [headers[start : start + HEADER] for start in range(0, len(headers), HEADER)]


@dataclass
class Held:
    """A message in an original node's database."""

    time_s: float  # full Unix time of its own messages, time modulo 65536 s of all others
    body: bytes  # type, priority, LZ4 frame: as they came

    @property
    def priority(self) -> int:
        return self.body[1]


@dataclass
class Pull:
    """What came of a pull."""

    offered: list[bytes] = field(default_factory=list)
    requested: list[bytes] = field(default_factory=list)
    stored: list[bytes] = field(default_factory=list)
    ended: bool = False  # the end was acknowledged


class Original:
    """An original node: a context manager that answers on its ports while it is open.

    `override(code, argument)` may return another reply body than the true one (or SILENT); None
    leaves the true one. `dead` names the peers whose port has been killed by a request.
    """

    def __init__(
        self,
        team: Team,
        name: str,
        *,
        now_s: Callable[[], float],
        timeout_s: float = 20.0,
        override: Callable[[bytes, bytes], bytes | None] | None = None,
    ) -> None:
        self.robot = team.robot(name)
        self.override = override
        self.requests: list[bytes] = []  # all that it received, without the ids
        self.dead: set[str] = set()
        self.stopped = False  # its database is locked for good
        self.messages: dict[tuple[int, int], dict[bytes, Held]] = {}
        self._team = team
        self._now_s = now_s
        self._timeout_ms = round(timeout_s * 1000)
        self._quits: list[zmq.Socket[bytes]] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self._context = zmq.Context()
        for number, peer in enumerate(self.robot.peers):
            server = self._context.socket(zmq.REP)
            server.linger = 0
            server.bind(f"tcp://{self.robot.listen}:{self.robot.port_for(peer)}")
            near, far = self._context.socket(zmq.PAIR), self._context.socket(zmq.PAIR)
            near.linger = far.linger = 0
            far.bind(f"inproc://quit-{number}")
            near.connect(f"inproc://quit-{number}")
            self._quits.append(near)
            thread = threading.Thread(target=self._serve, args=(peer, server, far))
            self._threads.append(thread)
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        for quits in self._quits:
            quits.send(b"")
        for thread in self._threads:
            thread.join()
        for quits in self._quits:
            quits.close()
        self._context.term()

    def publish(self, topic: str, data: bytes) -> bytes:
        """A message of its own; returns the header. The same millisecond overwrites."""
        known = self._team.topic(self.robot.name, topic)
        now_s = self._now_s()
        raw = header(self.robot.robot_id, known.topic_id, now_s)
        body = packed(known.dtype, known.priority, data)
        self.put(raw, body, time_s=now_s)
        return raw

    def put(self, raw: bytes, body: bytes, *, time_s: float | None = None) -> None:
        """Whatever is put there is kept and handed on; nothing is ever forgotten."""
        topic = self.messages.setdefault((raw[0], raw[1]), {})
        topic[raw] = Held(wire_s(raw) if time_s is None else time_s, body)

    def body(self, raw: bytes) -> bytes | None:
        """What it keeps under a header."""
        held = self.messages.get((raw[0], raw[1]), {}).get(raw)
        return held.body if held else None

    def data(self, robot: str, topic: str) -> bytes | None:
        """What its publisher would show of a topic: the newest by its own clock of things."""
        known = self._team.topic(robot, topic)
        kept = self.messages.get((self._team.robot(robot).robot_id, known.topic_id))
        if not kept:
            return None
        newest = max(kept.values(), key=lambda held: held.time_s)
        return bytes(lz4.frame.decompress(newest.body[2:]))  # raises on junk, as it does there

    def header_list(self) -> list[bytes]:
        """The newest of each topic, by priority, time and bytes, all descending."""
        listed = []
        for topic in self.messages.values():
            raw, held = max(topic.items(), key=lambda item: item[1].time_s)
            if held.time_s <= STOPS_AT_S:
                self.stopped = True
            listed.append((held.priority, held.time_s, raw))
        return [raw for _, _, raw in sorted(listed, reverse=True)]

    def pull(self, peer: str, *, give_up_after: int | None = None) -> Pull:
        """One sync: list, data one after another, end. Stops where an answer is missing.

        `give_up_after`: the answer to the request after that many takes too long; it lets go.
        """
        pull = Pull()
        listed = self.reply_of(peer, b"GHEAD")
        if listed is None or len(listed) % HEADER:
            return pull  # the real one's channel is busy for ever after such a length
        pull.offered = split(listed)
        for raw in [raw for raw in pull.offered if self._is_newer(raw)]:
            pull.requested.append(raw)
            body = self.reply_of(peer, b"GDATA" + raw)
            if body is None or give_up_after == len(pull.stored):
                return pull
            self.put(raw, body)  # SERRM as well: it cannot tell it from a message
            pull.stored.append(raw)
        pull.ended = self.reply_of(peer, b"DENDT" + self.robot.name.encode()) == b"Ack"
        return pull

    def reply_of(self, peer: str, request: bytes, timeout_s: float | None = None) -> bytes | None:
        """The body of the reply to one request on a connection of its own; None: no answer."""
        robot = self._team.robot(peer)
        request_id = os.urandom(ID)
        timeout_ms = self._timeout_ms if timeout_s is None else round(timeout_s * 1000)
        with self._context.socket(zmq.REQ) as client:
            client.linger = 0
            client.connect(f"tcp://{robot.address}:{robot.port_for(self.robot.name)}")
            client.send(request_id + request)
            if not client.poll(timeout_ms):
                return None
            reply = client.recv()
        return reply[ID:] if reply[:ID] == request_id else None

    def answer(self, peer: str, parts: list[bytes]) -> bytes | None:
        """The whole reply to a request; None: the peer's port is dead, or all are."""
        request_id, request = parts[0][:ID], parts[0][ID:]
        self.requests.append(request)
        if self._dies_of(parts):
            self.dead.add(peer)
        answer = SILENT if peer in self.dead else self._answer(request)
        return None if answer == SILENT or self.stopped else request_id + answer

    def _is_newer(self, raw: bytes) -> bool:
        kept = self.messages.get((raw[0], raw[1]))
        return not kept or wire_s(raw) > max(held.time_s for held in kept.values())

    def _serve(self, peer: str, server: zmq.Socket[bytes], quits: zmq.Socket[bytes]) -> None:
        poller = zmq.Poller()
        poller.register(server, zmq.POLLIN)
        poller.register(quits, zmq.POLLIN)
        while not (ready := dict(poller.poll())).get(quits):
            if server not in ready:
                continue
            answer = self.answer(peer, server.recv_multipart())
            if answer is None:
                poller.unregister(server)  # the port stays open, and no node answers any more
            else:
                server.send(answer)
        server.close()
        quits.close()

    def _dies_of(self, parts: list[bytes]) -> bool:
        code, argument = parts[0][ID : ID + CODE], parts[0][ID + CODE :]
        try:
            (code + (argument if code == b"DENDT" else b"")).decode()
        except UnicodeDecodeError:
            return True
        return len(parts) != 1

    def _answer(self, request: bytes) -> bytes:
        code, argument = request[:CODE], request[CODE:]
        changed = self.override(code, argument) if self.override else None
        if changed is not None:
            return changed
        match code:
            case b"GHEAD":
                return b"".join(self.header_list())
            case b"GDATA":
                return self.body(argument) or JUNK
            case b"DENDT":
                return b"Ack"
            case _:
                return JUNK
