"""What was delivered as a share of what the contacts allowed."""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.link.emulator import Emulator
from benchmarks.link.links import Link
from benchmarks.link.offer import Offer
from benchmarks.link.ways import ENDED

LONG_CONTACT_S = 3.0


@dataclass(frozen=True, slots=True)
class Score:
    """The outcome of one way on one link.

    Attributes:
        share: bytes of complete, intact messages by `rate x sum of (contact - one round trip)`.
            A round trip is what a request costs at least. Every message counts once. If all that
            was offered came across, contacts count only up to the last delivery.
        delivered_bytes: the same as a number.
        allowed_bytes: what it is a share of.
        empty_contacts: contacts of 3 s or more in which no message became complete.
        contacts: of them there were so many.
        sent_bytes: IP bytes that the link carried to the wanting node, and back.
        overflowed, cut_off: packets that the queues threw away, that a contact's end did.
        damaged: messages that arrived other than they were.
        cores: what the two nodes and the emulator took while the link was up.
        last_s, ended_s: from the first contact's begin to the last message, and until the two
            had reported to each other that there is no more (the latter only of the nodes).
        firsts_s: from each contact's begin to the first message in it; None: it brought none.
        late_ms: how late the emulator moved packets: median, 99th percentile, worst.
    """

    way: str
    link: Link
    share: float
    delivered_bytes: int
    allowed_bytes: float
    offered_bytes: int
    messages: int
    by_contact: tuple[int, ...]
    empty_contacts: int
    contacts: int
    sent_bytes: tuple[int, int]
    overflowed: int
    cut_off: int
    damaged: int
    cores: float
    last_s: float | None
    ended_s: float | None
    firsts_s: tuple[float | None, ...]
    late_ms: tuple[float, float, float]

    @classmethod
    def of(  # noqa: PLR0913 - all that was seen
        cls,
        way: str,
        link: Link,
        *,
        offer: Offer,
        emulator: Emulator,
        delivered: Sequence[tuple[float, int]],
        damaged: Sequence[int],
        cpu_s: float = 0.0,
    ) -> "Score":
        contacts = emulator.contacts_s
        begins = [begin for begin, _ in contacts]
        by_contact = [0] * len(contacts)
        firsts_s: list[float | None] = [None] * len(contacts)
        got: dict[int, float] = {}
        ended_s = None
        for at_s, key in delivered:
            if key == ENDED:
                ended_s = ended_s or at_s - begins[0]
            elif key not in got and key not in damaged:
                got[key] = at_s
                number = max(0, bisect.bisect(begins, at_s) - 1)
                by_contact[number] += offer.sizes[key]
                firsts_s[number] = firsts_s[number] or at_s - begins[number]
        total = sum(by_contact)
        ends = [end for _, end in contacts]
        if len(got) == offer.count:
            ends = [min(end, max(got.values())) for end in ends]
        open_s = sum(
            max(0.0, end - begin - link.rtt_s) for begin, end in zip(begins, ends, strict=True)
        )
        allowed = link.rate_bytes_s * open_s
        late = sorted(ms for lane in emulator.lanes for ms in lane.traffic.late_ms) or [0.0]
        long = link.window_s >= LONG_CONTACT_S
        there, back = (lane.traffic for lane in emulator.lanes)
        return cls(
            way=way,
            link=link,
            share=total / allowed if allowed else 0.0,
            delivered_bytes=total,
            allowed_bytes=allowed,
            offered_bytes=offer.total_bytes,
            messages=len(got),
            by_contact=tuple(by_contact),
            empty_contacts=sum(not each for each in by_contact) if long else 0,
            contacts=len(contacts) if long else 0,
            sent_bytes=(there.carried_bytes, back.carried_bytes),
            overflowed=there.overflowed + back.overflowed,
            cut_off=there.cut_off + back.cut_off,
            damaged=len(damaged),
            cores=cpu_s / (len(contacts) * link.window_s),
            last_s=max(got.values()) - begins[0] if got else None,
            ended_s=ended_s,
            firsts_s=tuple(firsts_s),
            late_ms=(late[len(late) // 2], late[int(len(late) * 0.99)], late[-1]),
        )
