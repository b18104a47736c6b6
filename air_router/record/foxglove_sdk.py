"""A record, or a flight while it lasts, through Foxglove's SDK: an MCAP file or a live socket.

What Foxglove has a schema for goes out in its protobuf form, everything else as the JSON that it is
in the record. Needs the extra `foxglove`.
"""

import base64
import io
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import foxglove
from foxglove import messages
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor import FieldDescriptor

from air_router.errors import RefusedError
from air_router.record.log import Log
from air_router.record.serialization import RecordChannel, json_of
from mocha_link.errors import Guard

_PREFIX: Final = "foxglove."
_RENAMED: Final = {"GeoJSON": "GeoJson"}
_TIMES: Final = frozenset({"google.protobuf.Timestamp", "google.protobuf.Duration"})

Encoder = Callable[[dict[str, Any]], bytes]
"""Writes a message as a channel has it."""


class FoxgloveChannels:
    """Sends messages of a record into a context of the SDK, which files and sockets listen to."""

    def __init__(self, context: foxglove.Context) -> None:
        self._context = context
        self._channels: dict[str, tuple[foxglove.Channel, Encoder]] = {}  # open, by topic

    def send(self, channel: RecordChannel, time_ns: int, message: dict[str, Any]) -> None:
        """Send a message, if it is listened to."""
        if channel.topic not in self._channels:
            self._channels[channel.topic] = self._opened(channel)
        opened, encode = self._channels[channel.topic]
        if opened.has_sinks():
            opened.log(encode(message), log_time=time_ns)

    def _opened(self, channel: RecordChannel) -> tuple[foxglove.Channel, Encoder]:
        name = channel.schema_name
        encode: Encoder
        if name.startswith(_PREFIX):
            schema, encode, encoding = _schema(name), _protobuf(name), "protobuf"
        else:
            schema = foxglove.Schema(name=name, encoding="jsonschema", data=channel.schema.encode())
            encode, encoding = lambda message: json_of(message).encode(), "json"
        opened = foxglove.Channel(
            channel.topic, schema=schema, message_encoding=encoding, context=self._context
        )
        return opened, encode


def foxglove_mcap(log: Log) -> bytes:
    """A record as an MCAP file with Foxglove's protobuf schemas.

    Raises:
        LogError: it is no record of a flight.
    """
    context, file = foxglove.Context(), io.BytesIO()
    channels = FoxgloveChannels(context)
    with foxglove.open_mcap(file, context=context):
        for channel, time_ns, message in log.messages():
            channels.send(channel, time_ns, message)
    return file.getvalue()


class FoxgloveSocket(foxglove.ServerListener):  # type: ignore[misc]
    """Serves a flight to Foxglove while it lasts. Nothing can be asked of it.

    Args:
        host: The address to serve on; another than this machine's shows the flight to the network.
        port: 0 takes a free one.
        name: What Foxglove calls it.

    Attributes:
        address: What to open in Foxglove.

    Raises:
        RefusedError: it cannot be served there.
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        context = foxglove.Context()
        self._channels = FoxgloveChannels(context)
        self._newest: dict[str, tuple[RecordChannel, int, dict[str, Any]]] = {}  # by topic
        self._harmless = Guard("something is not shown in Foxglove")
        self._late_harmless = Guard("a viewer who has just come is not shown something in Foxglove")
        try:
            self._server = foxglove.start_server(
                name=name, host=host, port=port, context=context, server_listener=self
            )
        except RuntimeError as error:
            raise RefusedError(f"--foxglove {host}:{port}: {error}; choose another port") from None
        self.address = f"ws://{host}:{self._server.port}"

    def send(self, channel: RecordChannel, time_ns: int, message: dict[str, Any]) -> None:
        """Send a message; what fails is told now and then, and the flight goes on."""
        self._newest[channel.topic] = (channel, time_ns, message)
        with self._harmless:
            self._channels.send(channel, time_ns, message)

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the newest message of a topic to those who have just come, on the SDK's thread."""
        del client
        newest = self._newest.get(channel.topic)
        if newest is not None:
            with self._late_harmless:  # a guard is for one thread
                self._channels.send(*newest)


@cache
def _protobuf(schema_name: str) -> Encoder:
    """What writes a message of one of Foxglove's schemas in protobuf."""
    files = descriptor_pb2.FileDescriptorSet.FromString(_schema(schema_name).data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema_name))
    return lambda message: _filled(kind(), message).SerializeToString()


def _schema(schema_name: str) -> foxglove.Schema:
    name = schema_name.removeprefix(_PREFIX)
    return getattr(messages, _RENAMED.get(name, name)).get_schema()


def _filled(target: Any, plain: dict[str, Any]) -> Any:
    """A protobuf message with these fields. JSON has bytes as base64, times as `sec` and `nsec`."""
    if target.DESCRIPTOR.full_name in _TIMES:
        target.seconds, target.nanos = plain["sec"], plain["nsec"]
        return target
    for name, value in plain.items():
        field = target.DESCRIPTOR.fields_by_name[name]
        if isinstance(value, dict):
            _filled(getattr(target, name), value).SetInParent()
        elif not isinstance(value, list):
            is_bytes = field.type == FieldDescriptor.TYPE_BYTES
            setattr(target, name, base64.b64decode(value) if is_bytes else value)
        elif field.message_type is None:
            getattr(target, name).extend(value)
        else:
            for part in value:
                _filled(getattr(target, name).add(), part)
    return target
