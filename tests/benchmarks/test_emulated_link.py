"""What `make bench-link` measures with: the pure parts, without namespaces."""

from types import SimpleNamespace

import pytest

from benchmarks.link.emulator import Lane
from benchmarks.link.links import ALL, QUICK, Link
from benchmarks.link.offer import SPARE, Offer
from benchmarks.link.score import Score

LINK = Link(rtt_s=0.1, rate_bit_s=1e6, window_s=3.0, contacts=2)
PACKET = bytes(1250)  # 10 ms


def test_a_packet_takes_its_own_length_and_half_a_round_trip():
    lane = Lane(LINK, "seed")
    lane.put(PACKET, 5.0)
    lane.put(PACKET, 5.0)
    assert lane.due_s == pytest.approx(5.06)
    assert lane.take(5.059) == []
    assert lane.take(5.065) == [PACKET]
    assert lane.due_s == pytest.approx(5.07)


def test_what_does_not_fit_the_queue_is_dropped():
    lane = Lane(LINK, "seed")
    fits = LINK.queue_bytes // len(PACKET)
    for _ in range(fits + 3):
        lane.put(PACKET, 1.0)
    assert len(lane.take(9.0)) == fits
    assert lane.traffic.overflowed == 3


def test_the_end_of_a_contact_loses_what_is_under_way():
    lane = Lane(LINK, "seed")
    lane.put(PACKET, 1.0)
    lane.cut()
    lane.put(PACKET, 1.0)
    assert len(lane.take(9.0)) == 1
    assert lane.traffic.cut_off == 1


def test_no_link_runs_out_of_messages():
    assert len(ALL) == 27
    assert set(QUICK) <= set(ALL)
    for link in ALL:
        offer = Offer.for_link(link, seed=7)
        assert offer.count >= 100
        assert offer.total_bytes >= SPARE * link.capacity_bytes
    assert offer.data(3) == Offer.for_link(link, seed=7).data(3)


def test_a_share_is_of_what_the_contacts_leave_after_a_round_trip():
    offer = Offer.of(4, 1, size=10_000)
    emulator = SimpleNamespace(
        contacts_s=[(10.0, 13.0), (20.0, 23.0)],
        lanes=(Lane(LINK, "there"), Lane(LINK, "back")),
    )
    delivered = [(10.5, 0), (20.6, 1), (20.7, 1), (20.8, 2)]
    score = Score.of("way", LINK, offer=offer, emulator=emulator, delivered=delivered, damaged=[2])
    assert score.delivered_bytes == 20_000
    assert score.share == pytest.approx(20_000 / (125_000 * 2 * 2.9))
    assert score.by_contact == (10_000, 10_000)
    assert score.firsts_s == pytest.approx((0.5, 0.6))
    assert (score.empty_contacts, score.contacts) == (0, 2)


def test_contacts_after_the_last_message_do_not_count_when_all_is_delivered():
    offer = Offer.of(1, 1, size=10_000)
    emulator = SimpleNamespace(
        contacts_s=[(10.0, 13.0), (20.0, 23.0)],
        lanes=(Lane(LINK, "there"), Lane(LINK, "back")),
    )
    score = Score.of("way", LINK, offer=offer, emulator=emulator, delivered=[(10.5, 0)], damaged=[])
    assert score.share == pytest.approx(10_000 / (125_000 * 0.4))
