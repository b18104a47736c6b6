"""The radio: moves IP packets between two interfaces, late, slowly, and only in contact."""

import os
import random
import select
import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from benchmarks.link.links import Link

LEAD_S = 0.3  # silence before the first contact: what the nodes sent while starting is thrown away
REPORT_S = 1.0  # a radio repeats its readings


@dataclass(slots=True)
class Traffic:
    """What one direction has seen, and how punctual the emulator was."""

    carried_packets: int = 0
    carried_bytes: int = 0
    overflowed: int = 0
    lost: int = 0
    cut_off: int = 0
    late_ms: list[float] = field(default_factory=list)


class Lane:
    """One direction: a drop-tail queue, a rate, a delay. Packets and times in, packets out."""

    def __init__(self, link: Link, seed: str) -> None:
        self.traffic = Traffic()
        self._link = link
        self._chance = random.Random(seed)
        self._free_s = 0.0
        self._under_way: deque[tuple[float, bytes]] = deque()

    def put(self, packet: bytes, now_s: float) -> None:
        """A packet was sent."""
        link = self._link
        start_s = max(now_s, self._free_s)
        if round((start_s - now_s) * link.rate_bytes_s) + len(packet) > link.queue_bytes:
            self.traffic.overflowed += 1
            return
        self._free_s = start_s + len(packet) / link.rate_bytes_s
        if link.loss and self._chance.random() < link.loss:
            self.traffic.lost += 1
            return
        self._under_way.append((self._free_s + link.rtt_s / 2, packet))

    @property
    def due_s(self) -> float | None:
        """When the next packet arrives."""
        return self._under_way[0][0] if self._under_way else None

    def take(self, now_s: float) -> list[bytes]:
        """The packets that have arrived by now."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_s:
            due_s, packet = self._under_way.popleft()
            self.traffic.late_ms.append((now_s - due_s) * 1e3)
            self.traffic.carried_packets += 1
            self.traffic.carried_bytes += len(packet)
            arrived.append(packet)
        return arrived

    def cut(self) -> None:
        """The contact is over: what is under way is lost."""
        self.traffic.cut_off += len(self._under_way)
        self._under_way.clear()
        self._free_s = 0.0


class Emulator:
    """Emulates a link between two interfaces for all its contacts, in real time.

    `report(received)` is called as the two radios would: at the begin of a contact and every second
    while it lasts with True, at its end with False.
    """

    def __init__(self, link: Link, ends: tuple[int, int], seed: int) -> None:
        self.contacts_s: list[tuple[float, float]] = []
        self.lanes = (Lane(link, f"{seed} there"), Lane(link, f"{seed} back"))
        self._link = link
        self._ends = ends

    def run(
        self, report: Callable[[bool], None], turn: Callable[[], AbstractContextManager[None]]
    ) -> None:
        """Go through all contacts; returns at the end of the last one.

        Each takes place within a `turn`; waiting for it makes the gap longer.
        """
        for number in range(self._link.contacts):
            self._silence(self._link.gap_s if number else LEAD_S)
            with turn():
                for end in self._ends:
                    _packets(end)
                self._contact(report)

    def _silence(self, lasts_s: float) -> None:
        ends_s = time.monotonic() + lasts_s
        while (left_s := ends_s - time.monotonic()) > 0:
            ready, _, _ = select.select(self._ends, (), (), left_s)
            for end in ready:
                _packets(end)

    def _contact(self, report: Callable[[bool], None]) -> None:
        began_s = time.monotonic()
        ends_s, report_s = began_s + self._link.window_s, began_s
        there, back = self.lanes
        first, second = self._ends
        lanes_of = ((first, there), (second, back))
        outlets = ((there, second), (back, first))
        while (now_s := time.monotonic()) < ends_s:
            if now_s >= report_s:
                report_s += REPORT_S
                report(True)
            for lane, outlet in outlets:
                for packet in lane.take(now_s):
                    _write(outlet, packet)
            wake_s = min(ends_s, report_s, *(lane.due_s or ends_s for lane in self.lanes))
            ready, _, _ = select.select(self._ends, (), (), max(0.0, wake_s - time.monotonic()))
            for end, lane in lanes_of:
                if end in ready:
                    for packet in _packets(end):
                        lane.put(packet, time.monotonic())
        for lane in self.lanes:
            lane.cut()
        self.contacts_s.append((began_s, ends_s))
        report(False)


def _packets(end: int) -> list[bytes]:
    packets = []
    try:
        while True:
            packets.append(os.read(end, 65_536))
    except BlockingIOError:
        return packets


def _write(end: int, packet: bytes) -> None:
    try:
        os.write(end, packet)
    except OSError:  # the node is gone, or its kernel does not want the packet
        return
