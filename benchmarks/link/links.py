"""The emulated links, and what a contact on one of them allows."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

# An original node is ready for the next trigger 12.4 s after a cut in the middle of an exchange:
# with a longer gap every contact begins with all nodes ready.
GAP_S = 13.0
CONTACTS = {1.0: 6, 3.0: 4, 10.0: 3}  # by the length of a contact: more of the short ones
QUEUE_PACKETS = 20


@dataclass(frozen=True, slots=True)
class Link:
    """A radio link that comes and goes; the same in both directions, which do not share the rate.

    Attributes:
        rtt_s: round-trip time of a small packet; half of it in each direction.
        rate_bit_s: of IP packets, headers included.
        window_s: how long a contact lasts.
        contacts: how many there are.
        gap_s: how long nothing gets through between two contacts.
        loss: share of the packets that is lost at random.
    """

    rtt_s: float
    rate_bit_s: float
    window_s: float
    contacts: int
    gap_s: float = GAP_S
    loss: float = 0.0

    @property
    def name(self) -> str:
        text = f"{self.rtt_s * 1e3:g} ms, {self.rate_bit_s / 1e6:g} Mbit/s, {self.window_s:g} s"
        return f"{text}, {self.loss:.0%} loss" if self.loss else text

    @property
    def rate_bytes_s(self) -> float:
        return self.rate_bit_s / 8

    @property
    def queue_bytes(self) -> int:
        """Room of the drop-tail queue: 20 full packets, or what is under way in a round trip."""
        return max(QUEUE_PACKETS * 1500, round(self.rate_bytes_s * self.rtt_s))

    @property
    def duration_s(self) -> float:
        return self.contacts * (self.window_s + self.gap_s) - self.gap_s

    @property
    def capacity_bytes(self) -> float:
        """What the contacts carry at most, counted without any round trip."""
        return self.rate_bytes_s * self.window_s * self.contacts

    def with_gap(self, gap_s: float) -> "Link":
        return replace(self, gap_s=gap_s)


ALL = tuple(
    Link(rtt_s, rate_bit_s, window_s, CONTACTS[window_s])
    for rtt_s, rate_bit_s, window_s in itertools.product(
        (0.005, 0.05, 0.3), (0.25e6, 1e6, 10e6), (1.0, 3.0, 10.0)
    )
)
QUICK = tuple(
    link
    for link in ALL
    if (link.rtt_s, link.rate_bit_s, link.window_s)
    in {(0.005, 10e6, 1.0), (0.05, 1e6, 3.0), (0.05, 0.25e6, 3.0), (0.3, 1e6, 3.0)}
)
LOSSY = tuple(
    replace(link, loss=loss)
    for loss in (0.01, 0.05, 0.10, 0.20)
    for link in ALL
    if (link.rtt_s, link.rate_bit_s, link.window_s) == (0.05, 1e6, 10.0)
)


def chosen(text: str, links: Sequence[Link] = ALL) -> tuple[Link, ...]:
    """The links that a text names: `50/1/3` = 50 ms, 1 Mbit/s, 3 s; `*` = any; several by commas.

    Raises:
        ValueError: no link is meant by a part of it.
    """
    found: list[Link] = []
    for part in text.split(","):
        wanted = part.strip().split("/")
        fits = [
            link
            for link in links
            if len(wanted) == 3
            and all(
                one in ("*", f"{value:g}")
                for one, value in zip(
                    wanted, (link.rtt_s * 1e3, link.rate_bit_s / 1e6, link.window_s), strict=True
                )
            )
        ]
        if not fits:
            raise ValueError(f"no link is '{part}'; write RTT ms/Mbit/s/contact s, e.g. 50/1/3")
        found.extend(link for link in fits if link not in found)
    return tuple(found)
