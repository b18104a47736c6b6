"""A telemetry radio that tells its state by MAVLink RADIO_STATUS, as SiK radios do."""

from __future__ import annotations

import functools
import importlib
import socket
import struct
from typing import Any

from mocha_link.errors import RadioError, needs_extra
from mocha_link.links.reading import Reading, Unit
from mocha_link.radios.port import Report
from mocha_link.radios.streams import bound, datagrams
from mocha_link.radios.thread_radio import ThreadRadio
from mocha_link.team.url import RadioUrl

UNKNOWN = 255
STATUS_NAMES = ("RADIO_STATUS", "RADIO")  # RADIO: the same fields, from old SiK firmware


class MavlinkRadio(ThreadRadio):
    """Listens for RADIO_STATUS at ``mavlink://host:port?peer=io``; the radio links to one peer.

    A MAVLink router or a ground station can forward the radio's messages there.
    """

    def __init__(self, url: RadioUrl, peer: str) -> None:
        super().__init__()
        self._url = url
        self._peer = peer
        self._socket: socket.socket | None = None  # while it listens

    @property
    def port(self) -> int | None:
        """The port that it listens on."""
        return int(self._socket.getsockname()[1]) if self._socket else self._url.port

    def start(self, report: Report) -> None:
        """Begin to listen. Raises RadioError if the port is taken or the host is not ours."""
        _dialect()  # the import takes a moment; not on the thread
        receiver = self._socket = bound(self._url, socket.SOCK_DGRAM)

        def take(raw: bytes) -> None:
            try:
                readings = parse_radio_status(raw)
            except RadioError as error:
                self.refuse(error)
                return
            for reading in readings:
                self.pass_on(report, self._peer, reading)

        self._begin(lambda stopped: datagrams(receiver, stopped, take))

    def close(self) -> None:
        """Stop listening."""
        super().close()
        self._socket = None


def parse_radio_status(datagram: bytes) -> list[Reading | None]:
    """What the RADIO_STATUS messages in a datagram say; None: the radio does not know.

    A reading is the weaker of the strengths at both ends, since an exchange needs both. Other
    messages and junk are left out. Raises RadioError.
    """
    parser = _dialect().MAVLink(None)
    parser.robust_parsing = True
    try:
        messages = parser.parse_buffer(datagram) or []
    except (ValueError, IndexError, KeyError, TypeError, struct.error) as error:
        raise RadioError(f"no MAVLink: {error}") from None
    return [_reading(each) for each in messages if each.get_type() in STATUS_NAMES]


def _reading(status: Any) -> Reading | None:
    known = [end for end in (status.rssi, status.remrssi) if end != UNKNOWN]
    return Reading(float(min(known)), Unit.DEVICE, "mavlink") if known else None


@functools.cache
def _dialect() -> Any:
    with needs_extra("a radio that tells its state by MAVLink", "mavlink"):
        return importlib.import_module("pymavlink.dialects.v20.ardupilotmega")
