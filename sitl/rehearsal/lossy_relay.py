"""A UDP relay between companion and vehicle that loses packets, and listens in for the judge."""

from __future__ import annotations

import random
import select
import socket
import struct
import threading
import time
from typing import TYPE_CHECKING, Any, Final, Self

if TYPE_CHECKING:
    from collections.abc import Callable

_HEARTBEAT, _COMMAND_ACK, _HIL_STATE_QUATERNION = 0, 77, 115
_PLACE: Final = struct.Struct("<36xiii")
_HEAD: Final = 10


class LossyRelay:
    """Passes datagrams both ways on a thread of its own.

    Args:
        companion_port: Where the companion listens.
        loss: Share of datagrams that are lost, each way.
        seed: Of what is lost.

    Attributes:
        api_port: Where the vehicle sends its API link.
        truth_port: Where the vehicle sends its truth.
        silent: Nothing passes.
        truth: Latitude, longitude in degrees and altitude in metres AMSL, as it really is.
        mode: The vehicle's custom mode, as it said last.
        armed: As it said last.
        failsafe: Whether it has ever said that a failsafe acts.
    """

    def __init__(self, companion_port: int, loss: float, seed: int) -> None:
        self._companion = ("127.0.0.1", companion_port)
        self._loss = loss
        self._chance = random.Random(f"relay {seed}")  # noqa: S311 - weather
        self._ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
        for end in self._ends:
            end.bind(("127.0.0.1", 0))
        self._api, self._outside, self._truth = self._ends
        self.api_port = int(self._api.getsockname()[1])
        self.truth_port = int(self._truth.getsockname()[1])
        self.silent = False
        self.truth: tuple[float, float, float] | None = None
        self.mode = 0
        self.armed = self.failsafe = False
        self._vehicle: Any = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        for end in self._ends:
            end.close()

    def inject(self, frame: bytes) -> None:
        """Send something to the vehicle in somebody else's name."""
        if self._vehicle is not None:
            self._api.sendto(frame, self._vehicle)

    def _run(self) -> None:
        while not self._stop.is_set():
            for end in select.select(self._ends, [], [], 0.1)[0]:
                data, sender = end.recvfrom(65536)
                if end is self._truth:
                    self._look(data)
                elif end is self._api:
                    self._vehicle = sender
                    self._look(data)
                    if self._passes():
                        self._outside.sendto(data, self._companion)
                elif self._vehicle is not None and self._passes():
                    self._api.sendto(data, self._vehicle)

    def _passes(self) -> bool:
        return not self.silent and self._chance.random() >= self._loss

    def _look(self, data: bytes) -> None:
        """Frames may come several in a datagram."""
        at = 0
        while at + _HEAD < len(data) and data[at] == 0xFD:
            length = data[at + 1]
            payload = data[at + _HEAD : at + _HEAD + length]
            number = int.from_bytes(data[at + 7 : at + 10], "little")
            if number == _HEARTBEAT and data[at + 6] == 1:
                padded = payload.ljust(9, b"\0")
                self.mode = int.from_bytes(padded[:4], "little")
                self.armed = bool(padded[6] & 128)
                self.failsafe |= padded[7] >= 5
            elif number == _HIL_STATE_QUATERNION:
                latitude, longitude, altitude = _PLACE.unpack(payload.ljust(48, b"\0")[:48])
                self.truth = (latitude / 1e7, longitude / 1e7, altitude / 1e3)
            at += _HEAD + length + 2


def wait_until(condition: Callable[[], bool], limit_s: float) -> bool:
    """Look every now and then, for so long at the most (wall clock)."""
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.02)
    return True
