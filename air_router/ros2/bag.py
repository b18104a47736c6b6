"""The record of a flight as a ROS 2 bag: one MCAP file of the messages that the bridge publishes.

The decisions run again, as in a replay, and the flight's view is sampled as often as the bridge
polls it. `ros2 bag play`, RViz and PlotJuggler read the file; no ROS installation is needed to make
it.
"""

import io
import math
from collections.abc import Iterable, Iterator
from typing import Any

from mcap.writer import CompressionType, Writer

from air_router.control import View
from air_router.flight import FlightStats, FlightView, situation
from air_router.live import RecordedFlight
from air_router.record import RecordEntry
from air_router.ros2.messages import TOPICS, OutgoingMessage, Scene
from air_router.ros2.sampler import POLL_S, Sampler
from mocha_link.bridges import channel
from mocha_link.ros import RosCodec, RosTypes

_PROFILE, _SCHEMA, _MESSAGE = "ros2", "ros2msg", "cdr"


def ros2_mcap(entries: Iterable[RecordEntry]) -> bytes:
    """A record as an MCAP file of the profile `ros2`; log times are the vehicle's Unix time.

    Raises:
        LogError: it is no record of a flight.
        RefusedError: there is no flight in it.
    """
    kept = list(entries)
    flight = RecordedFlight(kept)
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(_PROFILE, "air_router")
    bag = _Bag(writer, channel(flight.name or "uav")[1:])
    epoch_s = _epoch_s(kept)
    for t, message in _messages(flight, bag.name, epoch_s):
        bag.add(message, epoch_s + t)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


class _Bag:
    """Writes messages on the topics that the bridge advertises.

    Attributes:
        name: The vehicle's, as ROS takes it.
    """

    def __init__(self, writer: Writer, name: str) -> None:
        self.name = name
        self._writer = writer
        self._codec, self._types = RosCodec(), RosTypes(2, {})
        self._channels: dict[str, int] = {}  # registered in the file, by topic

    def add(self, message: OutgoingMessage, unix_s: float) -> None:
        topic, values = message
        data = self._codec.encode(TOPICS[topic], values, 2)
        time_ns = int(unix_s * 1e9)
        self._writer.add_message(self._channel(topic), time_ns, data, time_ns)

    def _channel(self, topic: str) -> int:
        if topic not in self._channels:
            kind = TOPICS[topic]
            schema = self._writer.register_schema(
                kind.replace("/", "/msg/"), _SCHEMA, self._types.definition(kind)[0].encode()
            )
            full = topic.replace("~", f"/{self.name}", 1)
            self._channels[topic] = self._writer.register_channel(full, _MESSAGE, schema)
        return self._channels[topic]


def _epoch_s(entries: Iterable[RecordEntry]) -> float:
    """Unix time at 0 on the vehicle's clock, as the record noted it first; 0 if it did not."""
    return next(
        (
            entry.value.fields["unix_s"] - entry.t
            for entry in entries
            if entry.kind == "note" and entry.value.name == "Clock"
        ),
        0.0,
    )


def _messages(
    flight: RecordedFlight, name: str, epoch_s: float
) -> Iterator[tuple[float, OutgoingMessage]]:
    """Every message with its time on the vehicle's clock."""
    mission = flight.router().graph.mission
    stats = FlightStats.of(mission, flight.mapper, flight.status().targets)
    view = FlightView(mission, flight.status, flight.router, stats)
    sampler = Sampler(
        Scene(name, mission.frame.origin),
        lambda what: view.fields_for(View.model_validate({"request": "view", what: True})),
    )
    steps = math.floor((flight.end_s - flight.begin_s) / POLL_S) + 1
    for step in range(steps):
        now_s = flight.begin_s + step * POLL_S
        while not flight.go_on(now_s, stats):
            pass
        fields: dict[str, Any] = {
            **situation(mission.frame, flight.status(), None),
            **view.fields_for(View(request="view")),
        }
        for message in sampler.messages(fields, epoch_s + now_s):
            yield now_s, message
