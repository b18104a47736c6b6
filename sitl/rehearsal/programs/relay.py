"""A UDP relay between companion and vehicle that spoils what passes, and writes down all of it."""

from __future__ import annotations

import contextlib
import itertools
import random
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Self

from sitl.mavlink import Frame, frames
from sitl.process import PaceServer
from sitl.rehearsal.fakes import Station, StreamFault
from sitl.rehearsal.judge import WireMessage
from sitl.rehearsal.programs.recording import ITEM_FIELDS, MISSION, Recording

_BUFFER: Final = 2**22
_PAUSE_S: Final = 0.2
_VEHICLE, _STATION = 1, 255  # system ids
_ACCEPTED: Final = 0  # MAV_MISSION_RESULT
_COMMANDS: Final = frozenset({"COMMAND_LONG", "COMMAND_INT"})
_READY_SPEED: Final = 1.0
"""Times real time until it is armed: only from then on the companion reports how far it is."""


@dataclass(slots=True)
class Weather:
    """What happens to datagrams and frames.

    Attributes:
        loss: Share of datagrams that are lost, each way.
        silent: Nothing passes.
        streams: What is the matter with messages from the vehicle, by name ("": with all others):
            they are lost, frozen or late.
        late_s: By how much those that are late come late, wall clock.
        commands: What is lost of the commands to the vehicle, by MAV_CMD.
    """

    loss: float = 0.0
    silent: bool = False
    streams: dict[str, StreamFault] = field(default_factory=dict)
    late_s: float = 0.0
    commands: frozenset[int] = frozenset()


class LossyRelay:
    """Passes datagrams both ways on a thread of its own, and keeps the world's pace.

    A busy machine must not change what happens: the vehicle's clock waits for this relay and for
    who reports to it how far it has worked (`air_router.vehicle.pace`).

    Args:
        companion_port: Where the companion listens.
        seed: Of what is lost.
        ports: Where the vehicle sends its API link and its truth; 0 takes free ones.
        speed: Times real time that the vehicle flies at most.

    Attributes:
        api_port: Where the vehicle sends its API link.
        truth_port: Where the vehicle sends its truth.
        pace_port: Where vehicle, companion and team report how far they are.
        weather: What is done to what passes; may be changed at any time.
        recording: What was seen.
        copy_truth_to: A port that gets the truth as well; 0: none.
        hold: Called with whether the vehicle has to wait, for one that does not follow the pace.
    """

    def __init__(
        self, companion_port: int, seed: int, ports: tuple[int, int] = (0, 0), speed: float = 1.0
    ) -> None:
        self._companion = ("127.0.0.1", companion_port)  # its address
        self._chance = random.Random(f"relay {seed}")  # noqa: S311 - weather
        # Where the vehicle's API link and truth come in, and the companion's; then other vehicles'.
        self._ends = [*map(_bound, (*ports, 0))]
        self._api, self._truth, self._outside = self._ends
        self.api_port = int(self._api.getsockname()[1])
        self.truth_port = int(self._truth.getsockname()[1])
        self.weather = Weather()
        self.recording = Recording()
        self.copy_truth_to = 0
        self._answers: Callable[[WireMessage], None] = lambda _message: None  # on a plan
        self.hold: Callable[[bool], object] = lambda _waits: None
        self._pace = PaceServer(("127.0.0.1", 0), expected=0)
        self.pace_port = self._pace.port
        self._speed = speed
        self._granted = (0.0, time.monotonic())  # vehicle's time it may reach; when
        self._flown = False  # it was armed once: `_READY_SPEED` is over
        self._vehicle: Any = None  # address of its last packet; None: nothing received yet
        self._first: dict[str, bytes] = {}  # frames that stand for the frozen, by name
        self._waiting: deque[tuple[float, bytes]] = deque()  # late frames: when, wall clock
        self._stop = threading.Event()
        self._paused = threading.Event()  # its ports are the vehicle's for a moment
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._pace.close()
        for end in self._ends:
            end.close()

    def pace(self) -> dict[str, Any]:
        """How the pace was kept; see `Pace.as_json`."""
        return self._pace.as_json(self._speed)

    def inject(self, data: bytes) -> None:
        """Send something to the vehicle in another's name."""
        for frame in frames(data):
            self.recording.record_frame(frame, delivered=True)
        if self._vehicle is not None:
            self._api.sendto(data, self._vehicle)

    def station(self, system: int = _STATION) -> Station:
        """A ground station whose messages reach the vehicle through it."""
        return Station(system, lambda sender, *message: self.inject(sender.pack_values(*message)))

    def upload(self, items: Sequence[Mapping[str, Any]], stored: Callable[[], object]) -> None:
        """Have a station put a mission on board; `stored` is called once PX4 accepts it."""
        station = self.station()

        def answer(message: WireMessage) -> None:
            if message.target != _STATION:
                return
            if message.name == "MISSION_ACK" and message.fields["type"] == _ACCEPTED:
                stored()
            elif message.name in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}:
                seq = int(message.fields["seq"])
                if seq < len(items):
                    fields = {name: items[seq][name] for name in ITEM_FIELDS}
                    station.send("MISSION_ITEM_INT", seq=seq, **fields)

        self._answers = answer
        station.send("MISSION_COUNT", count=len(items))

    def intrude(self, data: bytes) -> None:
        """Send something to the companion, from a place where no vehicle is."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as intruder:
            intruder.sendto(data, self._companion)

    def claim(self, data: bytes) -> None:
        """Send something to the companion from the vehicle's own port."""
        self._outside.sendto(data, self._companion)

    def move(self) -> None:
        """From now on the vehicle's messages come from another port, as after a radio's restart."""
        old = self._outside
        self._outside = self._ends[2] = _bound(0)
        old.close()

    def while_closed(self, restart: Callable[[], object]) -> None:
        """Give the vehicle's ports free while it is started anew: PX4 wants them to be."""
        self._paused.set()
        time.sleep(_PAUSE_S)
        for end in (self._api, self._truth):
            end.close()
        restart()
        self._api, self._truth = map(_bound, (self.api_port, self.truth_port))
        self._ends[:2] = self._api, self._truth
        self._paused.clear()

    def listen(self, port: int) -> None:
        """Take what another vehicle sends there for the companion as well."""
        self._ends.append(_bound(port))

    def _run(self) -> None:
        try:
            self._relay()
        finally:  # a relay that is gone releases no vehicle
            self.hold(False)

    def _relay(self) -> None:
        while not self._stop.is_set():
            if self._paused.is_set():
                time.sleep(_PAUSE_S / 10)
                continue
            with contextlib.suppress(OSError, ValueError):  # a socket that has just been replaced
                ready = select.select([*self._ends, *self._pace.sockets], [], [], 0.05)[0]
                for end in ready:
                    if end in self._ends:
                        data, sender = end.recvfrom(65536)
                        self._pass(end, data, sender)
                self._pace.attend(ready)
            now_s = time.monotonic()
            while self._waiting and self._waiting[0][0] <= now_s:
                self._deliver(self._waiting.popleft()[1])
            self._keep_pace(now_s)

    def _keep_pace(self, wall_s: float) -> None:
        clock_s = self.recording.clock_s
        if clock_s == 0.0:
            return  # it has not reported its clock yet
        limit = self._pace.limit(clock_s, wall_s, self.recording.received_s)
        self._flown = self._flown or self.recording.armed
        speed = limit.most_speed if self._flown else _READY_SPEED
        granted_s, since_s = self._granted
        freely = speed >= self._speed or granted_s == 0.0
        granted_s = clock_s if freely else granted_s + (wall_s - since_s) * speed
        self._granted = (granted_s, wall_s)
        self.hold(clock_s > granted_s or clock_s >= limit.until_s)

    def _pass(self, end: socket.socket, data: bytes, sender: Any) -> None:
        if end is self._truth:
            for frame in frames(data):
                self.recording.see(frame)
            if self.copy_truth_to:
                self._truth.sendto(data, ("127.0.0.1", self.copy_truth_to))
            return
        if end not in self._ends[:3]:
            self._outside.sendto(data, self._companion)
            return
        passes = not self.weather.silent and self._chance.random() >= self.weather.loss
        if end is self._outside:
            kept = b""
            for frame in frames(data):
                delivered = passes and not self._swallows(frame)
                self.recording.record_frame(frame, delivered=delivered)
                kept += frame.data if delivered else b""
            if kept and self._vehicle is not None:
                self._api.sendto(kept, self._vehicle)
            return
        if any(frame.system_id != _VEHICLE for frame in itertools.islice(frames(data), 1)):
            self._outside.sendto(data, self._companion)  # another vehicle on the same radio
            return
        self._vehicle = sender
        spoilt = b"".join(self._spoilt(data, passes=passes))
        if spoilt:
            self._deliver(spoilt)

    def _swallows(self, frame: Frame) -> bool:
        """Whether a frame to the vehicle is a command that is lost."""
        lost = self.weather.commands
        return bool(lost) and frame.name in _COMMANDS and frame.fields()["command"] in lost

    def _spoilt(self, data: bytes, *, passes: bool) -> Iterator[bytes]:
        """What of a vehicle's datagram reaches the companion now."""
        weather = self.weather
        fair = passes and not weather.streams
        for frame in frames(data):
            fault = weather.streams.get(frame.name, weather.streams.get(""))
            lost = fault is StreamFault.LOST or not passes
            self.recording.record_frame(frame, delivered=not lost)
            if frame.name.startswith(MISSION) and self.recording.messages:
                self._answers(self.recording.messages[-1])
            if lost or fair:
                continue
            if fault is StreamFault.FROZEN:
                yield self._first.setdefault(frame.name, frame.data)
            elif fault is StreamFault.LATE:
                self._waiting.append((time.monotonic() + weather.late_s, frame.data))
            else:
                yield frame.data
        if fair:
            yield data

    def _deliver(self, data: bytes) -> None:
        """The vehicle's messages reach the companion."""
        self.recording.record_datagram(data)
        self._outside.sendto(data, self._companion)


def _bound(port: int) -> socket.socket:
    """A UDP port of this machine; 0 takes a free one."""
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    end.bind(("127.0.0.1", port))
    return end


def wait_until(condition: Callable[[], bool], limit_s: float) -> bool:
    """Look every now and then, for so long at the most (wall clock)."""
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.02)
    return True
