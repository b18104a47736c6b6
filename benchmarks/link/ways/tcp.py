"""A raw TCP stream with resume: about the best that TCP can do in a contact.

The wanting side connects as soon as the contact begins and sends what it has: a bit for every
complete message and how much of which one is begun. The other side streams the rest.
"""

import contextlib
import socket
import struct
import threading

from benchmarks.link.offer import Offer
from benchmarks.link.ways import ADDRESSES, Deliver

PORT = 7001
_BEGUN = struct.Struct("!II")  # which message is begun, how many bytes of it are there
_PIECE = struct.Struct("!III")  # which message, from which byte on, how many bytes follow


class TcpSource:
    def __init__(self, offer: Offer) -> None:
        self._messages = {key: offer.data(key) for key in range(offer.count)}
        self._stream: socket.socket | None = None
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)

    def start(self) -> None:
        self._listener.bind((ADDRESSES[0], PORT))
        self._listener.listen()
        threading.Thread(target=self._serve, daemon=True).start()

    def signal_received(self, *, again: bool) -> None:
        pass

    def lost(self) -> None:
        hang_up(self._stream)

    def close(self) -> None:
        hang_up(self._listener)

    def data(self, key: int) -> bytes | None:
        return self._messages.get(key)

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                stream, _ = self._listener.accept()
                self._stream = stream
                threading.Thread(target=self._send, args=(stream,), daemon=True).start()

    def _send(self, stream: socket.socket) -> None:
        with contextlib.suppress(OSError):
            request = receive(stream, _BEGUN.size + (len(self._messages) + 7) // 8)
            begun, offset = _BEGUN.unpack_from(request)
            have = request[_BEGUN.size :]
            order = [begun] if offset else []
            order += [key for key in sorted(self._messages, reverse=True) if key not in order]
            for key in order:
                if have[key // 8] >> key % 8 & 1:
                    continue
                begin = offset if offset and key == begun else 0
                rest = self._messages[key][begin:]
                stream.sendall(_PIECE.pack(key, begin, len(rest)) + rest)
            stream.shutdown(socket.SHUT_WR)


class TcpSink:
    def __init__(self, offer: Offer, deliver: Deliver) -> None:
        self._offer = offer
        self._deliver = deliver
        self._messages: dict[int, bytes] = {}
        self._begun: tuple[int, bytearray] = (0, bytearray())
        self._stream: socket.socket | None = None

    def start(self) -> None:
        pass

    def signal_received(self, *, again: bool) -> None:
        if not again:
            self._stream = socket.socket()
            threading.Thread(target=self._receive, args=(self._stream,), daemon=True).start()

    def lost(self) -> None:
        hang_up(self._stream)

    def close(self) -> None:
        hang_up(self._stream)

    def data(self, key: int) -> bytes | None:
        return self._messages.get(key)

    def _receive(self, stream: socket.socket) -> None:
        with contextlib.suppress(OSError):
            stream.connect((ADDRESSES[0], PORT))
            have = bytearray((self._offer.count + 7) // 8)
            for key in self._messages:
                have[key // 8] |= 1 << key % 8
            key, begun = self._begun
            stream.sendall(_BEGUN.pack(key, len(begun)) + have)
            while True:
                key, offset, length = _PIECE.unpack(receive(stream, _PIECE.size))
                if self._begun[0] != key or len(self._begun[1]) != offset:
                    self._begun = (key, bytearray())
                begun = self._begun[1]
                while length:
                    data = stream.recv(min(length, 65_536))
                    if not data:
                        return
                    begun += data
                    length -= len(data)
                self._messages[key] = bytes(begun)
                self._begun = (0, bytearray())
                self._deliver(key)


def receive(stream: socket.socket, length: int) -> bytes:
    """Exactly so many bytes; ConnectionError at the end of the stream."""
    data = bytearray()
    while len(data) < length:
        more = stream.recv(length - len(data))
        if not more:
            raise ConnectionError("the stream has ended")
        data += more
    return bytes(data)


def hang_up(stream: socket.socket | None) -> None:
    """Close at once and forget what is not sent: the next contact has a stream of its own."""
    if stream is None:
        return
    with contextlib.suppress(OSError):
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    with contextlib.suppress(OSError):
        stream.shutdown(socket.SHUT_RDWR)
    stream.close()
