"""A record or a live flight in Foxglove's SDK: an MCAP file or a live socket.

Messages with a Foxglove schema are sent as protobuf, all others as the record's JSON. Needs the
extra `foxglove`.
"""

import io
from collections.abc import Iterable
from typing import Any

import foxglove

from air_router.errors import RefusedError
from air_router.gossip import Mapper
from air_router.record.channels import RecordChannel
from air_router.record.drawing import Drawn, FlightDrawing
from air_router.record.log import Log, RecordEntry
from mocha_link.errors import Guard


class FoxgloveChannels:
    """Sends messages of a record to a context of the SDK, for files and sockets."""

    def __init__(self, context: foxglove.Context) -> None:
        self._context = context
        self._channels: dict[str, foxglove.Channel] = {}  # open, by topic

    def send(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        """Send a message, if there is a subscriber."""
        if channel.topic not in self._channels:
            self._channels[channel.topic] = foxglove.Channel(
                channel.topic,
                schema=foxglove.Schema(
                    name=channel.schema_name,
                    encoding=channel.schema_encoding,
                    data=channel.schema,
                ),
                message_encoding=channel.encoding,
                context=self._context,
            )
        opened = self._channels[channel.topic]
        if opened.has_sinks():
            opened.log(data, log_time=time_ns)


def foxglove_mcap(log: Log) -> bytes:
    """A record as an MCAP file with Foxglove's protobuf schemas; drawings are made again.

    Raises:
        LogError: It is no record of a flight.
    """
    context, file = foxglove.Context(), io.BytesIO()
    channels, drawing = FoxgloveChannels(context), _RecordDrawing()
    with foxglove.open_mcap(file, context=context):
        for message in log.messages():
            channels.send(message.channel, message.time_ns, message.data)
            for channel, data in drawing.drawn(message.entry, message.time_ns / 1e9):
                channels.send(channel, message.time_ns, data)
    return file.getvalue()


class _RecordDrawing:
    """Draws a record, independent of the drawings made in flight."""

    def __init__(self) -> None:
        self._made: tuple[FlightDrawing, Mapper] | None = None  # None until the setup

    def drawn(self, entry: RecordEntry, unix_s: float) -> Iterable[Drawn]:
        """The drawing of an entry."""
        if entry.kind == "setup":
            self._made = FlightDrawing(entry.value.mission), Mapper(entry.value.mission)
            return self._made[0].begin(unix_s)
        if self._made is None:
            return ()
        drawing, mapper = self._made
        painted = entry.kind == "patch" and mapper.paint(entry.value)
        return drawing.draw(mapper.grid if painted else entry.value, unix_s)


class FoxgloveSocket(foxglove.ServerListener):  # type: ignore[misc]
    """Serves a live flight to Foxglove. It accepts no requests.

    Args:
        host: The address to serve on; any but the loopback address exposes the flight to the
            network.
        port: The port; 0: any free port.
        name: The server's name in Foxglove.

    Attributes:
        address: The address to open in Foxglove.

    Raises:
        RefusedError: It cannot be served there.
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        context = foxglove.Context()
        self._channels = FoxgloveChannels(context)
        self._newest: dict[str, tuple[RecordChannel, int, bytes]] = {}  # by topic
        self._harmless = Guard("something is not shown in Foxglove")
        self._late_harmless = Guard("a viewer who has just come is not shown something in Foxglove")
        try:
            self._server = foxglove.start_server(
                name=name, host=host, port=port, context=context, server_listener=self
            )
        except RuntimeError as error:
            raise RefusedError(f"--foxglove {host}:{port}: {error}; choose another port") from None
        self.address = f"ws://{host}:{self._server.port}"

    def send(self, channel: RecordChannel, time_ns: int, data: bytes) -> None:
        """Send a message; failures are logged at intervals, and the flight continues."""
        self._newest[channel.topic] = (channel, time_ns, data)
        with self._harmless:
            self._channels.send(channel, time_ns, data)

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the newest message of a topic to a new subscriber, on the SDK's thread."""
        del client
        newest = self._newest.get(channel.topic)
        if newest is not None:
            with self._late_harmless:  # a guard is for one thread
                self._channels.send(*newest)
