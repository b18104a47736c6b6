"""An original node, as it behaves on the wire: requests one after another, a socket for each.

What it does is what was seen of the original nodes: the order of a pull, the socket per request,
the 6 s that it waits for an answer and the 6.2 s more until it takes the next trigger. Messages
are LZ4 frames behind two bytes, as everywhere in this protocol.
"""

import contextlib
import secrets
import struct
import threading
import time
from collections.abc import Callable

import lz4.frame
import zmq

from benchmarks.link.offer import Offer, place
from benchmarks.link.ways import ADDRESSES, ENDED, Deliver

NAMES = ("a", "b")  # robot ids 0 and 1; the robots whose messages are relayed come behind
PORT = 7100
REQUEST_TIMEOUT_MS = 6_000
SULK_S = 6.2
_STOP_LOOK_MS = 200
_ID_BYTES, _CODE_BYTES, _HEADER_BYTES = 6, 5, 6


def header_of(key: int, base_s: float) -> bytes:
    robot, topic = place(key)
    stamp_ms = int(base_s * 1e3) + key
    return struct.pack(
        "!BBHH", robot and robot + 1, topic, stamp_ms // 1000 % 65_536, stamp_ms % 1000
    )


def pack(data: bytes) -> bytes:
    return b"\0\0" + bytes(lz4.frame.compress(data))


class OriginalNode:
    """Serves what it holds to the other robot, and pulls from it when triggered."""

    def __init__(self, number: int, addresses: tuple[str, str] = ADDRESSES) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.bodies: dict[bytes, bytes] = {}
        self.newest: dict[bytes, int] = {}
        self.stored: Callable[[bytes], None] = lambda _: None
        self.ended: Callable[[], None] = lambda: None
        self._number = number
        self._addresses = addresses
        self._busy = False
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []

    def add(self, header: bytes, body: bytes) -> None:
        """Hold a message; of each robot's topic only the newest is announced."""
        self.bodies[header] = body
        stamp_ms = _stamp_ms(header)
        if stamp_ms > self.newest.get(header[:2], -1):
            self.newest[header[:2]] = stamp_ms

    def header_list(self) -> bytes:
        """Newest first; the priority, which comes before that, is the same for all here."""
        newest = [each for each in self.bodies if self.newest[each[:2]] == _stamp_ms(each)]
        newest.sort(key=lambda each: (_stamp_ms(each), each), reverse=True)
        return b"".join(newest)

    def answer(self, frame: bytes) -> bytes:
        request_id, code = frame[:_ID_BYTES], frame[_ID_BYTES : _ID_BYTES + _CODE_BYTES]
        argument = frame[_ID_BYTES + _CODE_BYTES :]
        match code:
            case b"GHEAD":
                body = self.header_list()
            case b"GDATA":
                body = self.bodies.get(argument, b"SERRM")
            case b"DENDT":
                body = b"Ack"
            case _:
                body = b"SERRM"
        return request_id + body

    def serve(self) -> None:
        server = self.context.socket(zmq.REP)
        server.linger = 0
        server.bind(f"tcp://{self._addresses[self._number]}:{PORT}")
        thread = threading.Thread(target=self._serve, args=(server,), daemon=True)
        self._threads.append(thread)
        thread.start()

    def trigger(self) -> None:
        """Pull, unless a pull is under way or the last failure is not slept over."""
        if self._busy:
            return
        self._busy = True
        thread = threading.Thread(target=self._pull, daemon=True)
        self._threads.append(thread)
        thread.start()

    def close(self) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join(1)

    def _serve(self, server: zmq.Socket[bytes]) -> None:
        # A blocking recv in the original; looking up now and then only serves to end.
        while not self._closing.is_set():
            if server.poll(_STOP_LOOK_MS):
                server.send(self.answer(server.recv()))
        server.close(0)

    def _pull(self) -> None:
        try:
            headers = self._request(b"GHEAD")
            if headers is None:
                return
            for start in range(0, len(headers), _HEADER_BYTES):
                header = headers[start : start + _HEADER_BYTES]
                if _stamp_ms(header) <= self.newest.get(header[:2], -1):
                    continue
                body = self._request(b"GDATA", header)
                if body is None:
                    return
                self.add(header, body)
                self.stored(header)
            if self._request(b"DENDT", NAMES[self._number].encode()):
                self.ended()
        finally:
            self._busy = False

    def _request(self, code: bytes, argument: bytes = b"") -> bytes | None:
        request_id = secrets.token_bytes(_ID_BYTES)
        client = self.context.socket(zmq.REQ)
        client.linger = 0
        client.connect(f"tcp://{self._addresses[1 - self._number]}:{PORT}")
        client.send(request_id + code + argument)
        try:
            ends_s = time.monotonic() + REQUEST_TIMEOUT_MS / 1e3
            while (left_s := ends_s - time.monotonic()) > 0 and not self._closing.is_set():
                if client.poll(round(min(_STOP_LOOK_MS, left_s * 1e3))):
                    reply = client.recv()
                    if reply[:_ID_BYTES] == request_id:
                        return reply[_ID_BYTES:]
                    break
        finally:
            client.close(0)
        self._closing.wait(SULK_S)
        return None


class OriginalSource:
    def __init__(self, offer: Offer, addresses: tuple[str, str] = ADDRESSES) -> None:
        self._offer = offer
        self._node = OriginalNode(0, addresses)

    def start(self) -> None:
        base_s = time.time() - 60
        for key in range(self._offer.count):
            self._node.add(header_of(key, base_s), pack(self._offer.data(key)))
        self._node.serve()

    def signal_received(self, *, again: bool) -> None:
        self._node.trigger()

    def lost(self) -> None:
        pass

    def close(self) -> None:
        self._node.close()

    def data(self, key: int) -> bytes | None:
        return self._offer.data(key)


class OriginalSink:
    def __init__(self, offer: Offer, deliver: Deliver) -> None:
        self._keys = {header_of(key, 0)[:2]: key for key in range(offer.count)}
        self._places = {key: found for found, key in self._keys.items()}
        self._deliver = deliver
        self._node = OriginalNode(1)
        self._headers: dict[bytes, bytes] = {}

    def start(self) -> None:
        self._node.stored = self._stored
        self._node.ended = lambda: self._deliver(ENDED)
        self._node.serve()

    def signal_received(self, *, again: bool) -> None:
        self._node.trigger()

    def lost(self) -> None:
        pass

    def close(self) -> None:
        self._node.close()

    def data(self, key: int) -> bytes | None:
        header = self._headers.get(self._places[key])
        with contextlib.suppress(RuntimeError):  # no LZ4 frame
            return bytes(lz4.frame.decompress(self._node.bodies[header][2:])) if header else None
        return None

    def _stored(self, header: bytes) -> None:
        self._headers[header[:2]] = header
        key = self._keys.get(header[:2])
        if key is not None:
            self._deliver(key)


def _stamp_ms(header: bytes) -> int:
    seconds, milliseconds = struct.unpack_from("!HH", header, 2)
    return int(seconds * 1000 + milliseconds)
