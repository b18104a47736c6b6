"""The simulated vehicle as a process: UDP links and the wall clock around `MavlinkVehicle`."""

import logging
import select
import socket
import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from air_router.errors import AirRouterError, ExitCode
from mocha_link.lifetime import Closeable
from sitl.mavlink import MavlinkLink, MavlinkVehicle, VehicleSettings
from sitl.process.pace import Pace

_log = logging.getLogger(__name__)

_LEAST_WAIT_S: Final = 0.004  # at high speeds several steps are done at once
_MOST_WAIT_S: Final = 0.02
_MOST_BEHIND_S: Final = 0.25
_SOON_S: Final = 1e-6
_LARGEST: Final = 65535  # bytes of a datagram that comes
_DATAGRAM: Final = 1400  # bytes of one that is sent
_MOST_AT_ONCE: Final = 100

Address = tuple[str, int]


class PortInUseError(AirRouterError):
    """A port that the vehicle has to have, or that it sends to, is taken."""

    exit_code = ExitCode.NO_VEHICLE


class UdpLink:
    """Sends to a partner, receives from any sender.

    PX4 sends to a fixed port of its own machine until a partner sends to it; from then on, and for
    as long as it runs, it sends to that first one. It receives from others, but never replies.

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


class LinkAddresses(NamedTuple):
    """Where one link of a vehicle receives (port 0: on a free one), and whom it sends to."""

    bind: Address
    partner: Address


class Ports(NamedTuple):
    """Where a vehicle listens and sends; see `px4_ports` for PX4's.

    Attributes:
        onboard: The API link; its partner is on PX4's port until another one talks.
        ground: The same of the ground station link; None: there is no such link.
        truth: The truth link, and its receiver.
    """

    onboard: LinkAddresses
    ground: LinkAddresses | None
    truth: LinkAddresses


HERE: Final = "127.0.0.1"


def px4_ports(instance: int, listen: str = HERE) -> Ports:
    """The ports of PX4's SITL instance N, which only ever sends to its own machine.

    Args:
        instance: N.
        listen: Where it receives. PX4 does so on all addresses: whoever reaches one flies it.
    """
    api = 14540 + instance if instance <= 9 else 14549
    return Ports(
        LinkAddresses((listen, 14580 + instance), (HERE, api)),
        LinkAddresses((listen, 18570 + instance), (HERE, 14550)),
        LinkAddresses((HERE, 19450 + instance), (HERE, 19410 + instance)),
    )


class VehicleProcess(Closeable):
    """Runs a vehicle; a context manager that frees its ports.

    Args:
        settings: The vehicle; its `speed` is what the clock keeps to, where `pace` lets it.
        ports: Its places on the network.
        pace: Which processes the clock waits for; None: none. Closed with the vehicle.

    Attributes:
        settings: As given.
        ports: As given.
        vehicle: The vehicle that runs.

    Raises:
        PortInUseError: one of the ports is taken.
    """

    def __init__(self, settings: VehicleSettings, ports: Ports, pace: Pace | None = None) -> None:
        self.settings, self.ports = settings, ports
        self._pace = pace or Pace()  # without one it waits for no process
        self.vehicle = MavlinkVehicle(settings)
        self._links: dict[MavlinkLink, UdpLink] = {}  # those that are open
        try:
            self._open(self.vehicle.onboard, ports.onboard, "API link")
            self._open(self.vehicle.ground, ports.ground, "GCS link")
            self._open(self.vehicle.truth, ports.truth, "truth")
        except BaseException:
            self.close()
            raise

    def port(self, link: MavlinkLink) -> int:
        """The port that a link receives on."""
        return self._links[link].port

    def pace(self) -> dict[str, Any]:
        """The speed that was requested and the one that was kept; see `Pace.as_json`."""
        return self._pace.as_json(self.settings.speed)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run until `stopped` is true; it is called at least fifty times a second."""
        level = logging.WARNING
        next_s = time.monotonic()
        held = False
        while not stopped():
            now_s = time.monotonic()
            limit = self._pace.limit(self.vehicle.autopilot.time_s, now_s)
            step_s = self.settings.step_s / min(self.settings.speed, limit.most_speed)
            if now_s - next_s > _MOST_BEHIND_S:
                if not held:
                    late_s = now_s - next_s
                    _log.log(level, "too slow for this speed: %.2f s of real time lost", late_s)
                    level = logging.DEBUG  # once is enough
                next_s = now_s
            held = False
            while next_s <= now_s:
                held = self.vehicle.autopilot.time_s >= limit.until_s - _SOON_S
                if held:
                    break
                self.vehicle.step()
                next_s += step_s
                if time.monotonic() > now_s + _MOST_WAIT_S:
                    break  # also one that is far behind listens
            self._flush()
            wait_s = next_s - time.monotonic()
            least_wait_s = _LEAST_WAIT_S if step_s < _LEAST_WAIT_S else 0.0
            timeout_s = min(max(wait_s, least_wait_s), _MOST_WAIT_S)
            self._receive(_MOST_WAIT_S if held else timeout_s, held=held)

    def close(self) -> None:
        """Free the ports."""
        self._pace.close()
        for end in self._links.values():
            end.close()
        self._links.clear()

    def _open(self, link: MavlinkLink, end: LinkAddresses | None, what: str) -> None:
        if end is not None:
            # On a free port only the partner that was named can mean us; truth has one receiver.
            fixed = link is self.vehicle.truth or end.bind[1] == 0
            self._links[link] = UdpLink(*end, what, fixed=fixed)

    def _receive(self, timeout_s: float, *, held: bool) -> None:
        """Handle datagrams until it is time for the next step, or the clock is held no more."""
        left_s, end_s = timeout_s, time.monotonic() + timeout_s
        while left_s >= 0.0:  # once at least
            ends: list[UdpLink | socket.socket] = [*self._links.values(), *self._pace.sockets]
            ready = select.select(ends, [], [], left_s)[0]
            if self._pace.attend(ready) and held:
                return
            for link, end in self._links.items():
                for datagram in end.receive() if end in ready else ():
                    if link is not self.vehicle.truth:
                        self.vehicle.receive(link, datagram)
            if ready:
                self._flush()
            left_s = end_s - time.monotonic()

    def _flush(self) -> None:
        for link in (self.vehicle.onboard, self.vehicle.ground, self.vehicle.truth):
            frames = link.take_frames()
            if frames and link in self._links:
                self._links[link].send(frames)
