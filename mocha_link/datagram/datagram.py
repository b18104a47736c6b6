"""A reliable, unordered, paced flow of frames over datagrams. No sockets, threads or clocks here.

For links where setting up a connection takes most of a contact. The first packet carries data, and
the rate measured in the last contact is used from the start. docs/datagrams.md describes the
packets and the sender.
"""

from __future__ import annotations

from collections.abc import Callable

from mocha_link.datagram import packet as wire
from mocha_link.datagram.address_proof import AddressProof
from mocha_link.datagram.outbox import Outbox
from mocha_link.datagram.pacing import AHEAD_S, UNKNOWN_RTT_S, Pacing
from mocha_link.datagram.packet import (
    ACK_BYTES,
    ALONE_BYTES,
    DATA_BYTES,
    LENGTH_BYTES,
    MAX_MASK,
)
from mocha_link.datagram.silence import DOWN_MARGIN_S, Silence, deviation_s

PACKET_BYTES = 1_400  # MTU of 1,500 - 20 for IP - 8 for UDP - 40 for a seal, with a margin
PIGGYBACK_BYTES = 16  # of an acknowledgement in a data packet; a longer one gets its own packet
SECOND_FRAME_BYTES = 300  # with less room left in a packet no further frame is requested
LEAST_QUOTA = 80  # with a smaller quota no packet is sent
CONTACT_REPEAT_S = 1.0  # a second contact within this time does not retransmit everything again


class Flow:
    """One end of a flow: delivers each frame of its `source` to the other end once, in any order.

    `source(room)` returns the next frame of at most `room` bytes, or None when there is none now.
    It is called when a packet can be sent, not before, so that the most urgent frame is sent first.
    Call `transmit` after every `receive`, at `wake_s`, and when the source has a frame again.
    Both ends begin with the same token. A node that has lost the state of a flow begins a new one.
    All times are steady seconds from the same clock.

    rate_bytes_s, rtt_s: measured by an earlier flow over this link; None: not known.
    first_number: the number of our first packet. A sender that cannot guess it cannot acknowledge
        packets that it did not receive.
    proven: the peer has proven its address. Otherwise the first acknowledgement proves it, and the
        bytes sent before that are limited.

    Attributes:
        token: identifies the flow.
        alive_s: when the last packet was received.
        refused: received packets that were invalid.
    """

    def __init__(  # noqa: PLR0913 - the options of a flow
        self,
        token: bytes,
        source: Callable[[int], bytes | None],
        *,
        rate_bytes_s: float | None = None,
        rtt_s: float | None = None,
        packet_bytes: int = PACKET_BYTES,
        first_number: int = 0,
        proven: bool = True,
    ) -> None:
        if len(token) != wire.TOKEN_BYTES:
            raise ValueError(f"a token has {wire.TOKEN_BYTES} bytes, not {len(token)}")
        self.token = token
        self.alive_s: float | None = None
        self.refused = 0
        self._source = source
        self._packet = packet_bytes  # bytes of a full packet
        self._address = AddressProof(proven=proven)
        self._pacing = Pacing(packet_bytes, rate_bytes_s=rate_bytes_s, rtt_s=rtt_s)
        self._arrivals = wire.Arrivals()
        self._outbox = Outbox(first_number)
        self._silence = Silence()
        self._dry = False  # the source had nothing
        self._contact_s: float | None = None  # when the contact began, until a packet is received
        self._blind = False  # packets given up at the contact may have arrived: send new ones first
        self._hello = False  # a packet must be sent now, even without frames

    # --- state for the caller

    @property
    def proven(self) -> bool:
        """Whether the peer has proven its address."""
        return self._address.proven

    @proven.setter
    def proven(self, proven: bool) -> None:
        self._address.proven = proven

    @property
    def down(self) -> bool:
        """Whether expected acknowledgements are overdue."""
        return self._silence.down

    @property
    def rtt_s(self) -> float | None:
        """The lowest recent round trip, in seconds, to remember for this link."""
        return self._pacing.rtt.min_s

    @property
    def rate_bytes_s(self) -> float | None:
        """The rate of the link in bytes/s, to remember for it; None if too little was sent."""
        return self._pacing.rate_bytes_s

    @property
    def rate_estimated(self) -> bool:
        """Whether the first packets of a contact have been used to estimate the rate."""
        return self._pacing.rate_estimated

    @property
    def bytes_out(self) -> int:
        """The bytes of all packets sent."""
        return self._address.bytes_out

    @property
    def arrived(self) -> int:
        """How many numbered packets of the peer were received; copies do not count."""
        return self._arrivals.count

    @property
    def settled(self) -> bool:
        """Whether everything that was sent has arrived."""
        return self._outbox.settled

    @property
    def wake_s(self) -> float | None:
        """When to call `transmit` if nothing is received before; None: no timer runs."""
        if self._hello:
            return 0.0
        times = [] if self._arrivals.due_s is None else [self._arrivals.due_s]
        if self._outbox.under_way:
            times.append(self._silence.due_s(self._pacing.rtt))
            overtaken_s = self._outbox.overtaken_s()
            if overtaken_s is not None:
                times.append(overtaken_s + self._patience_s())
        again = self._outbox.again is not None and self._quota() >= self._packet
        if not self.down and (again or not self._dry) and self._may_send():
            times.append(self._pacing.due_s)
        return min(times) if times else None

    # --- received packets

    def receive(self, packet: bytes, now_s: float) -> list[bytes]:
        """Process one datagram; returns its new frames. An invalid datagram is counted."""
        parsed = wire.parse(packet) if packet[1:7] == self.token else None
        if parsed is None or (parsed.ack and not self._outbox.credible(parsed.ack)):
            self.refused += 1
            return []
        self.alive_s = now_s
        self._address.bytes_in += len(packet)
        if parsed.ack:
            self._acknowledged(parsed.ack, now_s)
        if self.down:  # the link is back after a gap
            self._restart(now_s)
        self._silence.end(now_s)
        self._contact_s = None
        self._blind = False
        return parsed.frames if self._arrivals.take(parsed, now_s) else []

    def _acknowledged(self, ack: wire.Ack, now_s: float) -> None:
        stamps, newest = self._outbox.acknowledged(ack)
        if not stamps or self.down:  # the round trip would include the gap
            return
        arrived_s = now_s - ack.delay_s
        if newest is None or arrived_s <= newest.sent_s:
            arrived_s = now_s
        rtt_s = arrived_s - newest.sent_s if newest else None
        if self.proven:
            self._pacing.arrived(stamps, rtt_s, arrived_s)
            return
        self._address.proven = True
        if rtt_s is not None:
            self._pacing.rtt.add(rtt_s, now_s)
        self._restart(now_s)  # the few packets before this did not measure the link

    def _patience_s(self) -> float:
        """The time after which a packet counts as lost if a later one was acknowledged."""
        rtt_s = self._pacing.rtt.smoothed_s or UNKNOWN_RTT_S
        return 1.125 * rtt_s + min(deviation_s(self._pacing.rtt), 0.5 * rtt_s)

    def _restart(self, now_s: float) -> None:
        """Give up all packets in flight and restart the pacing: the link may have changed."""
        self._outbox.give_up()
        self._pacing.resume(now_s)

    def on_contact(self, now_s: float) -> None:
        """Note that a contact begins: send at once."""
        self._hello = True
        rtt_s = self._pacing.rtt.smoothed_s or UNKNOWN_RTT_S
        if self.alive_s is not None and now_s < self.alive_s + rtt_s + DOWN_MARGIN_S:
            return
        if self._contact_s is not None and now_s < self._contact_s + CONTACT_REPEAT_S:
            return
        self._blind = self._contact_s is None
        self._contact_s = now_s
        self._silence.end(now_s)
        self._restart(now_s)

    # --- packets to send

    def transmit(self, now_s: float) -> list[bytes]:
        """The datagrams to send now."""
        out: list[bytes] = []
        outbox = self._outbox
        outbox.lose(now_s - self._patience_s())
        if outbox.under_way and now_s >= self._silence.due_s(self._pacing.rtt):
            self._silence.probe(now_s)
            self._probe(None if self.down else outbox.oldest(), now_s, out)
        if not self.down:
            self._dry = False
            while self._may_send() and self._pacing.due_s <= now_s + AHEAD_S:
                packet = self._fill(now_s)
                if packet is None:
                    break
                out.append(packet)
        if self._hello and not out:
            self._probe(None, now_s, out)
        self._hello = False
        due_s = self._arrivals.due_s
        if due_s is not None and due_s <= now_s:
            self._acknowledge(now_s, out)
        return out

    def unacknowledged(self) -> list[bytes]:
        """The frames that were not acknowledged, for the caller to send by TCP as well."""
        bodies = self._outbox.bodies()
        return [frame for body in bodies for frame in wire.split(body, 0) or ()]

    def _probe(self, content: int | None, now_s: float, out: list[bytes]) -> None:
        if self._quota() >= self._packet:
            out.append(self._send(content, now_s))

    def _acknowledge(self, now_s: float, out: list[bytes]) -> None:
        """Send an acknowledgement alone, if the quota of the peer's address allows it."""
        room = self._address.quota - ALONE_BYTES
        ack = self._arrivals.acknowledge(now_s, min(room, MAX_MASK))
        if not ack:
            self._arrivals.defer()  # the peer's next packet allows more bytes, and makes one due
            return
        packet = wire.only_ack(self.token, ack)
        self._address.bytes_out += len(packet)
        out.append(packet)

    def _quota(self) -> int:
        """How many more bytes may be sent."""
        return 0 if self._outbox.exhausted else self._address.quota

    def _may_send(self) -> bool:
        if self._quota() < LEAST_QUOTA or self._outbox.full:
            return False
        return self._pacing.room(self._outbox.in_flight_bytes)

    def _fill(self, now_s: float) -> bytes | None:
        """The next packet with frames, or None."""
        outbox = self._outbox
        again = outbox.again if self._quota() >= self._packet else None  # only new ones fit a quota
        body = self._pull() if again is None or self._blind else b""
        if body:
            return self._send(outbox.content(body), now_s)
        if again is not None:
            return self._send(again, now_s)
        self._dry = True
        self._pacing.limited()
        return None

    def _pull(self) -> bytes:
        """Frames of the source, encoded for a packet; empty if there is none."""
        room = min(self._packet, self._quota()) - DATA_BYTES
        if self._arrivals.waiting:
            room -= ACK_BYTES + PIGGYBACK_BYTES
        frames: list[bytes] = []
        while not frames or room >= SECOND_FRAME_BYTES:
            frame = self._source(room - LENGTH_BYTES)
            if frame is None:
                break
            if len(frame) > room - LENGTH_BYTES:
                raise ValueError(f"a frame of {len(frame)} bytes where {room - LENGTH_BYTES} fit")
            frames.append(frame)
            room -= len(frame) + LENGTH_BYTES
        return wire.join(frames)

    def _send(self, content: int | None, now_s: float) -> bytes:
        """A numbered packet, with an acknowledgement if one fits."""
        outbox, arrivals = self._outbox, self._arrivals
        body = b"" if content is None else outbox.body(content)
        ack = b""
        if arrivals.waiting or (arrivals.count and not body):
            limit = min(self._packet, self._address.quota)
            room = limit - DATA_BYTES - ACK_BYTES - len(body)
            ack = arrivals.acknowledge(now_s, min(room, MAX_MASK)) if room >= 0 else b""
        packet = wire.data(
            self.token,
            outbox.next,
            floor=outbox.base,
            content=outbox.next if content is None else content,
            body=body,
            ack=ack,
        )
        self._silence.sent(now_s, first=not outbox.under_way)
        outbox.add(content, self._pacing.sent(len(packet), now_s, outbox.in_flight_bytes))
        self._address.bytes_out += len(packet)
        return packet
