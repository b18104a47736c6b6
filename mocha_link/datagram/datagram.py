"""A reliable, unordered, paced flow of frames over datagrams. No sockets, threads or clocks here.

For links where setting up a connection takes most of a contact: the first packet carries data, and
what the last contact showed of the link is used from the first moment on. docs/datagrams.md
describes the packets and what a sender does.
"""

from __future__ import annotations

from collections.abc import Callable

from mocha_link.datagram import packet as wire
from mocha_link.datagram.outbox import Acknowledged, Content, Outbox
from mocha_link.datagram.pacing import AHEAD_S, UNKNOWN_RTT_S, Pacing
from mocha_link.datagram.packet import ACK_BYTES, ACK_DELAY_S, DATA_BYTES, LENGTH_BYTES, MAX_MASK

MAX_QUOTA = 1 << 30
PACKET_BYTES = 1_400  # 1,500 of most links - 20 - 8 - 40 for a seal around it, and some to spare
PIGGYBACK_BYTES = 16  # a longer list of what arrived goes in a packet of its own
SECOND_FRAME_BYTES = 300  # with less room left in a packet no further frame is requested
GRANULARITY_S = 0.01
QUIET_S = 0.15  # without a packet for two round trips and this the link is down
PROBE_S = 0.1  # then probes leave at this distance, growing
MAX_PROBE_S = 1.0
LEAST_QUOTA = 80  # less is not worth a packet
RETURN = 3  # times the bytes received: more does not leave before the peer has proven its address
CONTACT_REPEAT_S = 1.0  # a second contact within this time does not send everything once more


class Flow:
    """One end. Whatever the `source` of one end hands out arrives at the other, once, in any order.

    `source(room)` returns the next frame of at most `room` bytes, or None when there is none now.
    The source is called when a packet can leave, not before, so the most urgent frame goes first.
    Call `transmit` after every `receive`, at `wake_s`, and when the source has something again.
    Both ends begin with the same token; who has lost the state of a flow begins another one.
    All times are steady seconds from the same clock.

    rate_bytes_s, rtt_s: what another flow showed of this link, if it is known.
    first_number: of our packets. Who cannot guess it cannot acknowledge what it did not get.
    proven: what we send gets to the peer itself, not to a victim in whose name it came. Otherwise
        that is shown by the first acknowledgement, and little leaves before it.
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
        self.alive_s: float | None = None  # when the last packet was received
        self.proven = proven
        self.refused = 0  # packets that were none
        self.repeated = 0  # packets whose frames had arrived before
        self.down = False  # an expected acknowledgement is overdue
        self._bytes_in = self._bytes_out = 0  # limit what leaves to an unproven address
        self._source = source
        self._packet = packet_bytes  # bytes of a full packet
        self._known_rate = rate_bytes_s  # remembered, bytes/s
        self._pacing = Pacing(packet_bytes, rate_bytes_s=rate_bytes_s, rtt_s=rtt_s)
        self._arrivals = wire.Arrivals()
        self._outbox = Outbox(first_number)
        self._dry = False  # the source had nothing
        self._progress_s = self._sent_s = 0.0  # of the last acknowledgement, of the last packet
        self._tail = False  # a probe for a lost tail is under way
        self._probe_s = 0.0  # when the next probe leaves
        self._probe_every_s = PROBE_S  # grows while it is down
        self._blind = False  # what of the last flight arrived is not known yet: it goes later
        self._contact_s: float | None = None  # when a contact began without a packet so far
        self._hello = False  # a packet has to leave now, whatever is in it

    # --- what others may know

    @property
    def rtt_s(self) -> float | None:
        """The lowest round trip of late, in seconds: for the memory of this link."""
        return self._pacing.rtt.min_s

    @property
    def rate_bytes_s(self) -> float | None:
        """Bytes/s that the link takes, for the memory of it; None if too little was sent."""
        return self._pacing.rate_bytes_s

    @property
    def judged(self) -> bool:
        """Whether the first packets of a contact have shown how fast the link is."""
        return self._pacing.judged

    @property
    def bytes_out(self) -> int:
        """How many bytes have left, in all packets."""
        return self._bytes_out

    @property
    def arrived(self) -> int:
        """How many numbered packets of the peer have come; copies of them count for nothing."""
        return self._arrivals.count

    @property
    def settled(self) -> bool:
        """Whether everything that was sent has arrived."""
        return self._outbox.settled

    @property
    def wake_s(self) -> float | None:
        """When to call `transmit` if nothing arrives before; None: no need."""
        if self._hello:
            return 0.0
        times = [] if self._arrivals.due_s is None else [self._arrivals.due_s]
        if self.down:
            return min([self._probe_s, *times])
        if self._outbox.under_way():
            times.append(self._alarm_s())
            overtaken_s = self._outbox.overtaken_s()
            if overtaken_s is not None:
                times.append(overtaken_s + self._patience_s())
        again = self._outbox.some_again and self._quota() >= self._packet
        if (again or not self._dry) and self._may_send():
            times.append(self._pacing.due_s)
        return min(times) if times else None

    # --- what comes in

    def receive(self, packet: bytes, now_s: float) -> list[bytes]:
        """Take in one datagram; returns the frames that are new. What is none is counted."""
        parsed = wire.parse(packet) if packet[1:7] == self.token else None
        if parsed is None or (parsed.ack and not self._outbox.credible(parsed.ack)):
            self.refused += 1
            return []
        self.alive_s = now_s
        self._bytes_in += len(packet)
        if parsed.ack:
            self._acknowledged(parsed.ack, now_s)
        if self.down:
            self._resume(now_s)
        self._progress_s = now_s
        self._blind = False
        self._contact_s = None
        if parsed.number is None:
            return []
        if self._arrivals.take(parsed, now_s):
            return parsed.frames
        self.repeated += bool(parsed.frames)
        return []

    def _acknowledged(self, ack: wire.Ack, now_s: float) -> None:
        outbox = self._outbox
        acked = outbox.acknowledged(ack)
        if acked.stamps and not self.proven:
            self._prove(acked, ack, now_s)
            return
        if not acked.stamps or self.down:  # after a gap its length would be measured
            return
        self._tail = False
        rtt_s = None
        came_s = now_s
        if acked.newest:
            rtt_s = now_s - acked.newest.sent_s
            if ack.delay_s < rtt_s:
                rtt_s -= ack.delay_s
                came_s -= ack.delay_s
        self._lose(now_s)
        self._pacing.arrived(acked.stamps, rtt_s, came_s, outbox.in_flight_bytes)

    def _prove(self, acked: Acknowledged, ack: wire.Ack, now_s: float) -> None:
        """Restart the pacing: the few packets before this did not measure the link."""
        self.proven = True
        rtt_s = None
        if acked.newest:
            rtt_s = max(now_s - acked.newest.sent_s - ack.delay_s, 0.0) or None
        self._outbox.give_up()
        self._pacing = Pacing(self._packet, rate_bytes_s=self._known_rate, rtt_s=rtt_s)
        self._pacing.resume(now_s)

    def _lose(self, now_s: float) -> None:
        for stamp in self._outbox.lose(now_s - self._patience_s()):
            self._pacing.lost(stamp)

    def _patience_s(self) -> float:
        """So long after its sending a packet that was overtaken is lost."""
        rtt = self._pacing.rtt
        return 1.125 * (rtt.smoothed_s or UNKNOWN_RTT_S) + max(4 * rtt.deviation_s, GRANULARITY_S)

    def _resume(self, now_s: float) -> None:
        """The link is back after a gap: what was under way is lost."""
        self._outbox.give_up()
        self.down = self._tail = False
        self._pacing.resume(now_s)

    def on_contact(self, now_s: float) -> None:
        """A contact begins: send at once."""
        self._hello = True
        rtt_s = self._pacing.rtt.smoothed_s or UNKNOWN_RTT_S
        if self.alive_s is not None and now_s < self.alive_s + rtt_s + QUIET_S:
            return
        if self._contact_s is not None and now_s < self._contact_s + CONTACT_REPEAT_S:
            return
        self._blind = self._contact_s is None
        self._contact_s = self._progress_s = now_s
        self._resume(now_s)

    # --- what goes out

    def transmit(self, now_s: float) -> list[bytes]:
        """The datagrams to send now."""
        out: list[bytes] = []
        self._watch(now_s, out)
        if not self.down:
            self._dry = False
            while self._may_send() and self._pacing.due_s <= now_s + AHEAD_S:
                packet = self._fill(now_s)
                if packet is None:
                    break
                out.append(packet)
        elif now_s >= self._probe_s:
            self._probe_s = now_s + self._probe_every_s
            self._probe_every_s = min(self._probe_every_s * 1.5, MAX_PROBE_S)
            self._probe(now_s, out)
        if self._hello:
            self._hello = False
            if not out:
                self._probe(now_s, out)
        due_s = self._arrivals.due_s
        if due_s is not None and due_s <= now_s:
            packet = wire.only_ack(self.token, self._arrivals.acknowledge(now_s))
            self._bytes_out += len(packet)
            out.append(packet)
        return out

    def reclaim(self) -> list[bytes]:
        """The frames that have not been acknowledged, to send them another way as well."""
        bodies = self._outbox.bodies()
        return [frame for body in bodies for frame in wire.split(body, 0) or ()]

    def _probe(self, now_s: float, out: list[bytes]) -> None:
        if self._quota() >= self._packet:
            out.append(self._send(None, now_s))

    def _quota(self) -> int:
        """How many bytes may leave."""
        if self._outbox.exhausted:
            return 0
        if self.proven:
            return MAX_QUOTA
        return RETURN * self._bytes_in - self._bytes_out

    def _may_send(self) -> bool:
        if not self.proven and self._quota() < LEAST_QUOTA:
            return False
        return self._pacing.room(self._outbox.in_flight_bytes) and not self._outbox.full

    def _alarm_s(self) -> float:
        """When the silence means something: first a lost tail, then a link that is down."""
        rtt = self._pacing.rtt
        rtt_s = rtt.smoothed_s or UNKNOWN_RTT_S
        down_s = self._progress_s + 2 * rtt_s + 4 * rtt.deviation_s + QUIET_S
        if self._tail:
            return down_s
        wait_s = rtt_s + max(4 * rtt.deviation_s, GRANULARITY_S) + ACK_DELAY_S
        return min(down_s, max(self._progress_s, self._sent_s) + wait_s)

    def _watch(self, now_s: float, out: list[bytes]) -> None:
        """Look at the clock: overtaken packets, a lost tail, a link that is down."""
        outbox = self._outbox
        if self.down or not outbox.under_way():
            return
        overtaken_s = outbox.overtaken_s()
        if overtaken_s is not None and overtaken_s + self._patience_s() <= now_s:
            self._lose(now_s)
        if not outbox.under_way() or now_s < self._alarm_s():
            return
        if self._tail:
            self.down = True
            self._probe_every_s = PROBE_S
            self._probe_s = now_s
        else:
            self._tail = True
            if self._quota() >= self._packet:
                out.append(self._send(outbox.oldest(), now_s))

    def _fill(self, now_s: float) -> bytes | None:
        """The next packet with frames, or None."""
        outbox = self._outbox
        scarce = self._quota() < self._packet  # new frames may be made to fit
        content = None
        if not self._blind and not scarce:  # blind: the next acknowledgement reports the arrivals
            content = outbox.again()
        if content is None:
            body = self._pull()
            if body:
                content = outbox.content(body)
            elif not scarce:
                content = outbox.again()
        if content is not None:
            return self._send(content, now_s)
        self._dry = True
        self._pacing.limited(outbox.in_flight_bytes)
        return None

    def _pull(self) -> bytes:
        """Frames of the source, as they stand in a packet; empty if there is none."""
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

    def _send(self, content: Content | None, now_s: float) -> bytes:
        """A numbered packet, and with it what arrived, if that fits."""
        outbox, arrivals = self._outbox, self._arrivals
        body = content.body if content else b""
        ack = b""
        if arrivals.waiting or (arrivals.any and not body):
            room = self._packet - DATA_BYTES - ACK_BYTES - len(body)
            ack = arrivals.acknowledge(now_s, min(room, MAX_MASK)) if room >= 0 else b""
        packet = wire.data(
            self.token,
            outbox.next,
            floor=outbox.base,
            content=content.number if content else outbox.next,
            body=body,
            ack=ack,
        )
        if not outbox.under_way():
            self._progress_s = now_s
        outbox.add(content, self._pacing.sent(len(packet), now_s, outbox.in_flight_bytes))
        self._sent_s = now_s
        self._bytes_out += len(packet)
        return packet
