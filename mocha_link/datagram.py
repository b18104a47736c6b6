"""A reliable, unordered, paced flow of frames over datagrams. No sockets, threads or clocks here.

For links where setting up a connection takes most of a contact: the first packet carries data, and
what the last contact showed of the link is used from the first moment on.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from mocha_link import packet as wire
from mocha_link.pacing import UNKNOWN_RTT_S, Pacing, Stamp
from mocha_link.packet import ACK_BYTES, DATA_BYTES, LENGTH_BYTES, MAX_MASK, MAX_NUMBER, WINDOW

if TYPE_CHECKING:
    from collections.abc import Callable

PACKET_BYTES = 1_192  # 1,280 (every IPv6 path) - 40 - 8 - 40 for a seal around it
PIGGYBACK_BYTES = 16  # a longer list of what arrived goes in a packet of its own
SECOND_FRAME_BYTES = 300  # with less room left in a packet nobody is asked for another frame
REORDERED = 3  # packets that may overtake another before it counts as lost
MAX_REORDERED = 128
GRANULARITY_S = 0.01
QUIET_S = 0.15  # nothing heard for two round trips and this: the link is down
PROBE_S = 0.1  # then probes leave at this distance, growing
MAX_PROBE_S = 1.0
POKE_S = 1.0  # a second poke within this time does not send everything once more


class _Content:
    """Frames that are to arrive, and whether they have."""

    __slots__ = ("arrived", "body", "number", "waiting")

    def __init__(self, number: int, body: bytes) -> None:
        self.number = number
        self.body = body
        self.arrived = False
        self.waiting = False  # to be sent again


class _Sent:
    """One packet under way."""

    __slots__ = ("content", "number", "settled", "stamp")

    def __init__(self, number: int, content: _Content | None, stamp: Stamp) -> None:
        self.number = number
        self.content = content
        self.stamp = stamp
        self.settled = False


class Flow:
    """One end. Whatever the `source` of one end hands out arrives at the other, once, in any order.

    `source(room)` returns the next frame of at most `room` bytes, or None when there is none now.
    It is asked when a packet can leave, not before, so what matters most can still go first. Call
    `transmit` after every `receive`, at `wake_s`, and when the source has something again.
    Both ends begin with the same token; who has lost the state of a flow begins another one.
    All times are steady seconds from the same clock.

    rate_bytes_s, rtt_s: what another flow showed of this link, if it is known.
    """

    def __init__(
        self,
        token: bytes,
        source: Callable[[int], bytes | None],
        *,
        rate_bytes_s: float | None = None,
        rtt_s: float | None = None,
        packet_bytes: int = PACKET_BYTES,
    ) -> None:
        if len(token) != wire.TOKEN_BYTES:
            raise ValueError(f"a token has {wire.TOKEN_BYTES} bytes, not {len(token)}")
        self.token = token
        self.alive_s: float | None = None
        self.refused = 0  # packets that were none
        self.repeated = 0  # packets that had arrived before
        self.packets_sent = 0
        self.packets_lost = 0
        self.in_flight_bytes = 0
        self._source = source
        self._packet = packet_bytes
        self._pacing = Pacing(packet_bytes, rate_bytes_s=rate_bytes_s, rtt_s=rtt_s)
        self._arrivals = wire.Arrivals()
        self._next = 0
        self._base = 0  # everything below is settled
        self._open = 0  # bit n: packet base + n is under way, or its content is not there
        self._flying: deque[_Sent] = deque()
        self._sent: dict[int, _Sent] = {}
        self._contents: dict[int, _Content] = {}
        self._again: deque[_Content] = deque()
        self._newest = -1  # the highest number that was acknowledged
        self._reordered = REORDERED
        self._dry = False  # the source had nothing
        self._progress_s: float | None = None
        self._sent_s = 0.0
        self._tails = 0  # probes since something was acknowledged
        self._down = False
        self._probe_s = 0.0
        self._probe_every_s = PROBE_S
        self._blind = False
        self._poked_s: float | None = None
        self._hello = False

    # --- what others may know

    @property
    def rtt_s(self) -> float | None:
        """The lowest round-trip time of late, in seconds: for the memory of this link."""
        return self._pacing.min_rtt_s

    @property
    def rate_bytes_s(self) -> float | None:
        """The rate of the link in bytes/s as far as it is known: for the memory of this link."""
        return self._pacing.rate or None

    @property
    def settled(self) -> bool:
        """Whether everything that was sent has arrived."""
        return not self._contents

    @property
    def wake_s(self) -> float | None:
        """When to call `transmit` if nothing arrives before; None: no need."""
        times = []
        if self._arrivals.due_s is not None:
            times.append(self._arrivals.due_s)
        if self._hello:
            return 0.0
        if self._down:
            times.append(self._probe_s)
        elif self._sent:
            times.append(self._alarm_s())
            if (again := self._late_s()) is not None:
                times.append(again)
        if not self._down and (self._again or not self._dry) and self._may_send():
            times.append(self._pacing.gate_s)
        return min(times) if times else None

    # --- what comes in

    def receive(self, packet: bytes, now_s: float) -> list[bytes]:
        """Take in one datagram; returns the frames that are new. What is none is counted."""
        parsed = wire.parse(packet) if packet[1:7] == self.token else None
        if parsed is None or (parsed.ack and not self._credible(parsed.ack)):
            self.refused += 1
            return []
        self.alive_s = now_s
        if parsed.ack:
            self._acknowledged(parsed.ack, now_s)
        if self._down:
            self._revive(now_s)
        self._progress_s = now_s
        self._blind = False
        if parsed.number is None:
            return []
        if self._arrivals.take(parsed, now_s):
            return parsed.frames
        if parsed.frames:
            self.repeated += 1
        return []

    def _credible(self, ack: wire.Ack) -> bool:
        """Whether it speaks only of packets that were sent."""
        return ack.start + ack.bits.bit_length() <= self._next and ack.below <= self._next

    def _unheard(self, ack: wire.Ack) -> int:
        """What an acknowledgement says that was not known, as bits from the base on."""
        base = self._base
        bits = (1 << (ack.below - base)) - 1 if ack.below > base else 0
        ahead = ack.start - base
        return (bits | (ack.bits << ahead if ahead >= 0 else ack.bits >> -ahead)) & self._open

    def _acknowledged(self, ack: wire.Ack, now_s: float) -> None:
        fresh = self._unheard(ack)
        if not fresh:
            return
        base = self._base
        stamps: list[Stamp] = []
        newest: _Sent | None = None
        while fresh:
            low = fresh & -fresh
            fresh ^= low
            number = base + low.bit_length() - 1
            sent = self._sent.pop(number, None)
            if sent is not None:
                sent.settled = True
                newest = sent
                self.in_flight_bytes -= sent.stamp.size
                stamps.append(sent.stamp)
                content = sent.content
            else:
                content = self._contents.get(number)
                if content is not None and number < self._newest and content.waiting:
                    self._premature(number)  # it was late, not lost
            self._open &= ~low
            if content is not None and not content.arrived:
                content.arrived = True
                del self._contents[content.number]
                if content.number != number and content.number not in self._sent:
                    self._open &= ~(1 << (content.number - base))
        rtt_s = self._round_trip(newest, ack.delay_s, now_s) if newest else None
        lost = self._lose(now_s)
        if not self._down:  # otherwise it would measure the gap
            self._pacing.arrived(stamps, rtt_s, lost, now_s, self.in_flight_bytes)
        self._settle()

    def _round_trip(self, newest: _Sent, delay_s: float, now_s: float) -> float | None:
        self._tails = 0
        if newest.number < self._newest:
            return None  # a late acknowledgement: it waited somewhere
        self._newest = newest.number
        rtt_s = now_s - newest.stamp.sent_s
        return max(rtt_s - delay_s if delay_s < rtt_s else rtt_s, 1e-4)

    def _premature(self, number: int) -> None:
        self._reordered = min(max(self._reordered, self._newest - number + 1), MAX_REORDERED)

    def _settle(self) -> None:
        if not self._open:
            self._base = self._next
        elif not self._open & 1:
            low = (self._open & -self._open).bit_length() - 1
            self._base += low
            self._open >>= low

    # --- what is lost

    def _patience_s(self) -> float:
        return 1.125 * (self._pacing.srtt_s or UNKNOWN_RTT_S) + GRANULARITY_S

    def _lose(self, now_s: float) -> int:
        """Give up packets that later ones have overtaken; how many bytes that was."""
        flying = self._flying
        size = 0
        late_s = now_s - self._patience_s()
        last = self._newest - self._reordered
        while flying:
            sent = flying[0]
            if not sent.settled:
                if sent.number > last and (
                    sent.number > self._newest or sent.stamp.sent_s > late_s
                ):
                    break
                size += sent.stamp.size
                self._drop(sent)
            flying.popleft()
        return size

    def _late_s(self) -> float | None:
        """When the oldest packet that others have overtaken counts as lost."""
        flying = self._flying
        while flying and flying[0].settled:
            flying.popleft()
        if flying and flying[0].number < self._newest:
            return flying[0].stamp.sent_s + self._patience_s()
        return None

    def _drop(self, sent: _Sent) -> None:
        sent.settled = True
        self.packets_lost += 1
        self.in_flight_bytes -= sent.stamp.size
        del self._sent[sent.number]
        content = sent.content
        if content is None or content.arrived or content.number != sent.number:
            self._open &= ~(1 << (sent.number - self._base))
        if content is not None and not content.arrived and not content.waiting:
            content.waiting = True
            self._again.append(content)

    def _revive(self, now_s: float) -> None:
        """The link is back after a gap: what was under way is lost."""
        for sent in self._flying:
            if not sent.settled:
                self._drop(sent)
        self._flying.clear()
        self._settle()
        self._again = deque(sorted(self._again, key=lambda content: content.number))
        self._down = False
        self._tails = 0
        self._pacing.resume(now_s)

    def poke(self, now_s: float) -> None:
        """A contact begins: send at once."""
        heard_s = now_s - self.alive_s if self.alive_s is not None else None
        rtt_s = self._pacing.srtt_s or UNKNOWN_RTT_S
        self._hello = True
        if heard_s is not None and heard_s < rtt_s + QUIET_S:
            return
        if self._poked_s is not None and now_s < self._poked_s + POKE_S and self._blind:
            return
        self._poked_s = now_s
        self._revive(now_s)
        self._blind = True
        self._progress_s = now_s

    # --- what goes out

    def _may_send(self) -> bool:
        return (
            self._pacing.room(self.in_flight_bytes)
            and self._next - self._base < WINDOW
            and self._next <= MAX_NUMBER
        )

    def _alarm_s(self) -> float:
        """When the silence means something: first a lost tail, then a link that is down."""
        pacing = self._pacing
        rtt_s = pacing.srtt_s or UNKNOWN_RTT_S
        since_s = self._progress_s or 0.0
        down_s = since_s + 2 * rtt_s + 4 * pacing.rttvar_s + QUIET_S
        if self._tails:
            return down_s
        wait_s = rtt_s + max(4 * pacing.rttvar_s, GRANULARITY_S) + wire.ACK_DELAY_S
        return min(down_s, max(since_s, self._sent_s) + wait_s)

    def transmit(self, now_s: float) -> list[bytes]:
        """The datagrams to send now."""
        out: list[bytes] = []
        self._watch(now_s, out)
        if not self._down:
            self._dry = False
            while self._may_send() and self._pacing.due(now_s):
                packet = self._fill(now_s)
                if packet is None:
                    break
                out.append(packet)
        elif now_s >= self._probe_s:
            self._probe_s = now_s + self._probe_every_s
            self._probe_every_s = min(self._probe_every_s * 1.5, MAX_PROBE_S)
            out.append(self._send(None, b"", now_s))
        if self._hello:
            self._hello = False
            if not out:
                out.append(self._send(None, b"", now_s))
        due_s = self._arrivals.due_s
        if due_s is not None and due_s <= now_s:
            out.append(wire.only_ack(self.token, self._arrivals.acknowledge(now_s)))
        return out

    def _watch(self, now_s: float, out: list[bytes]) -> None:
        """Look at the clock: lost packets, a lost tail, a link that is down."""
        if self._down or not self._sent:
            return
        late_s = self._late_s()
        if late_s is not None and late_s <= now_s:
            lost = self._lose(now_s)
            self._pacing.arrived([], None, lost, now_s, self.in_flight_bytes)
            self._settle()
        if not self._sent or now_s < self._alarm_s():
            return
        if not self._tails:
            self._tails = 1
            oldest = next((s.content for s in self._flying if not s.settled), None)
            if oldest is not None and oldest.arrived:
                oldest = None
            out.append(self._send(oldest, oldest.body if oldest else b"", now_s))
        else:
            self._down = True
            self._blind = False
            self._probe_every_s = PROBE_S
            self._probe_s = now_s

    def _fill(self, now_s: float) -> bytes | None:
        """The next packet with frames, or None."""
        if not (self._blind and self._again):
            again = self._next_again()
            if again is not None:
                return self._send(again, again.body, now_s)
        body = self._pull()
        if body:
            content = _Content(self._next, body)
            self._contents[self._next] = content
            return self._send(content, body, now_s)
        again = self._next_again()
        if again is not None:
            return self._send(again, again.body, now_s)
        self._dry = True
        self._pacing.idle(self.in_flight_bytes)
        return None

    def _next_again(self) -> _Content | None:
        while self._again:
            content = self._again.popleft()
            content.waiting = False
            if not content.arrived:
                return content
        return None

    def _pull(self) -> bytes:
        """Frames of the source, as they stand in a packet; empty if there is none."""
        room = self._packet - DATA_BYTES
        if self._arrivals.waiting:
            room -= ACK_BYTES + PIGGYBACK_BYTES
        frames: list[bytes] = []
        while room >= SECOND_FRAME_BYTES or not frames:
            frame = self._source(room - LENGTH_BYTES)
            if frame is None:
                break
            if len(frame) > room - LENGTH_BYTES:
                raise ValueError(f"a frame of {len(frame)} bytes where {room - LENGTH_BYTES} fit")
            frames.append(frame)
            room -= len(frame) + LENGTH_BYTES
        return wire.join(frames)

    def _send(self, content: _Content | None, body: bytes, now_s: float) -> bytes:
        number = self._next
        self._next += 1
        ack = b""
        arrivals = self._arrivals
        if arrivals.waiting or (arrivals.any and not body):
            room = self._packet - DATA_BYTES - ACK_BYTES - len(body)
            if room >= 0:
                ack = arrivals.acknowledge(now_s, min(room, MAX_MASK))
        packet = wire.data(
            self.token,
            number,
            floor=self._base,
            content=content.number if content else number,
            body=body,
            ack=ack,
        )
        if not self._sent:
            self._progress_s = now_s
        stamp = self._pacing.sent(len(packet), now_s, self.in_flight_bytes)
        sent = _Sent(number, content, stamp)
        self._sent[number] = sent
        self._flying.append(sent)
        self._open |= 1 << (number - self._base)
        self.in_flight_bytes += len(packet)
        self._sent_s = now_s
        self.packets_sent += 1
        return packet
