"""One UDP end of a MAVLink link, with PX4's rule that the first talker becomes the partner."""

import logging
import socket
from typing import Final

from air_router.errors import AirRouterError, ExitCode

_log = logging.getLogger(__name__)

_LARGEST: Final = 65535
_DATAGRAM: Final = 1400
_MOST_AT_ONCE: Final = 100

Address = tuple[str, int]


class PortInUseError(AirRouterError):
    """A port that the vehicle has to have, or that it sends to, is taken."""

    exit_code = ExitCode.NO_VEHICLE


class UdpLink:
    """Sends to a partner, receives from any sender.

    PX4 sends to a fixed port of its own machine until a partner sends to it; from then on, and for
    as long as it runs, it sends to that first one. Others are heard, but never answered.

    Args:
        bind: Host and port to receive on; port 0 takes a free one.
        partner: Where to send until a partner talks.
        what: For the error message.
        fixed: The partner stays, whatever comes: a datagram for the program that had this port
            before would take the vehicle away otherwise.

    Raises:
        PortInUseError: the port is taken.
    """

    def __init__(self, bind: Address, partner: Address, what: str, *, fixed: bool = False) -> None:
        self._partner = partner
        self._settled = fixed  # the partner stays
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(bind)
        except OSError as error:
            self._socket.close()
            raise PortInUseError(
                f"{what}: cannot use UDP port {bind[1]}: {error.strerror}; another vehicle runs "
                "on it: end that, or give this one another --instance"
            ) from None

    @property
    def port(self) -> int:
        """The port it receives on."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    def receive(self) -> list[bytes]:
        """The datagrams that have come in."""
        datagrams: list[bytes] = []
        while len(datagrams) < _MOST_AT_ONCE:
            try:
                datagram, sender = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except OSError as error:
                _log.debug("receiving: %s", error)
                break
            if not self._settled:
                self._settled, self._partner = True, sender
                _log.info("partner is %s:%d from now on", *sender)
            datagrams.append(datagram)
        return datagrams

    def send(self, frames: list[bytes]) -> None:
        """Send frames, as few datagrams as they fit into; what cannot be sent is lost."""
        datagram = b""
        for frame in frames:
            if datagram and len(datagram) + len(frame) > _DATAGRAM:
                self._send(datagram)
                datagram = b""
            datagram += frame
        if datagram:
            self._send(datagram)

    def close(self) -> None:
        """Free the port."""
        self._socket.close()

    def _send(self, datagram: bytes) -> None:
        try:
            self._socket.sendto(datagram, self._partner)
        except OSError as error:
            _log.debug("sending to %s:%d: %s", *self._partner, error)
