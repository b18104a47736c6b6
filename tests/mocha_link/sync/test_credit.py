"""How much may be sent ahead: enough to keep the link busy, no more, and never a standstill."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.sync.credit import (
    FIRST_WINDOW,
    GRANT,
    KNOWN_WINDOW,
    MAX_CHUNK,
    MAX_WINDOW,
    MIN_CHUNK,
    MIN_WINDOW,
    Credit,
)


def allowed(credit: Credit) -> int:
    return GRANT.unpack(credit.grant)[0]


def chunk(credit: Credit) -> int:
    return GRANT.unpack(credit.grant)[1]


def link(
    credit: Credit, *, rate: float, rtt_s: float, seconds: float, start_s: float = 0.0
) -> tuple[float, float]:
    """Drive it over a link; the share of it that was used, and the longest queue in seconds.

    The queue of the first `start_s` is not looked at.

    The peer sends whatever it may at once; grants need half a round trip back, frames the queue
    and half a round trip.
    """
    now_s = sent_s = idle_s = queue_s = 0.0
    sent = 0
    grants = [(0.0, credit.grant)]
    under_way: list[tuple[float, int]] = []
    limit, size = 0, MIN_CHUNK
    while now_s < seconds:
        while grants and grants[0][0] <= now_s:
            limit, size = GRANT.unpack(grants.pop(0)[1])
            assert MIN_CHUNK <= size <= MAX_CHUNK
        while sent < limit:
            frame = min(size, limit - sent)
            if sent_s < now_s:
                idle_s += now_s - sent_s
            sent_s = max(sent_s, now_s) + frame / rate
            if now_s >= start_s:
                queue_s = max(queue_s, sent_s - now_s)
            sent += frame
            under_way.append((sent_s + rtt_s / 2, frame))
        events = [each[0][0] for each in (grants, under_way) if each]
        assert events, "no side may send and nothing is under way: it stands still"
        now_s = min(events)
        while under_way and under_way[0][0] <= now_s:
            if credit.take(under_way.pop(0)[1], now_s, rtt_s):
                grants.append((now_s + rtt_s / 2, credit.grant))
    return 1 - idle_s / seconds, queue_s


def test_a_link_that_was_fast_last_time_and_is_slow_now():
    """What is urgent waits no longer than the first grant, whatever was remembered."""
    credit = Credit(200e6, 0.001)
    _, queue_s = link(credit, rate=125_000, rtt_s=0.05, seconds=20)
    assert queue_s < KNOWN_WINDOW / 125_000 + 0.5


LINKS = list(itertools.product((31_250, 1_250_000, 12_500_000), (0.005, 0.3)))


@pytest.mark.parametrize(("rate", "rtt_s"), LINKS)
def test_a_link_is_kept_busy_and_its_queue_short(rate, rtt_s):
    """Also one of which nothing is known yet, and after that one of which it is."""
    used, queue_s = link(Credit(None, None), rate=rate, rtt_s=rtt_s, seconds=20)
    assert used > 0.93
    assert queue_s < max(2.9 * rtt_s + 1.5 * 0.15, FIRST_WINDOW / rate) + 0.1
    _, queue_s = link(Credit(None, None), rate=rate, rtt_s=rtt_s, seconds=20, start_s=5)
    assert queue_s < max(1.5 * (rtt_s + 0.15), FIRST_WINDOW / rate) + 0.1
    known = Credit(rate, rtt_s)
    used, queue_s = link(known, rate=rate, rtt_s=rtt_s, seconds=20)
    assert used > 0.95
    assert queue_s < max(2.9 * rtt_s + 1.5 * 0.15, MIN_WINDOW / rate) + 0.1


@pytest.mark.parametrize("rtt_s", [0.05, 0.3])
def test_the_window_opens_as_fast_as_that_of_tcp(rtt_s):
    """A sender that doubles its own window in every round trip is hardly ever held back."""
    credit, limit, received, flight, now_s = Credit(None, None), FIRST_WINDOW, 0, 14_000.0, 0.0
    while flight < 4_000_000:
        assert received + 0.9 * flight <= limit, f"held back at {flight:.0f} bytes in a round trip"
        frames = int(flight // MIN_CHUNK)
        for frame in range(frames):  # spread over the round trip, as those of a paced sender are
            if credit.take(MIN_CHUNK, now_s + rtt_s * frame / frames, rtt_s):
                limit = allowed(credit)
        received += frames * MIN_CHUNK
        now_s += rtt_s
        flight *= 2


@given(
    st.one_of(st.none(), st.floats(0, 1e12)),
    st.one_of(st.none(), st.floats(0, 100)),
    st.lists(
        st.tuples(
            st.integers(0, MAX_CHUNK),
            st.floats(0, 10),
            st.one_of(st.none(), st.floats(0, 100)),
        ),
        max_size=60,
    ),
)
def test_whatever_comes_a_grant_is_within_bounds(rate, rtt_s, frames):
    """It never goes back, never promises more than the largest window, never stands still."""
    credit = Credit(rate, rtt_s)
    now_s, before = 0.0, allowed(credit)
    for size, passed_s, seen_s in frames:
        now_s += passed_s
        granted = credit.take(size, now_s, seen_s)
        after = allowed(credit)
        assert after >= before
        assert after - before <= MAX_WINDOW + size
        assert MIN_CHUNK <= chunk(credit) <= MAX_CHUNK
        if granted:
            assert after - credit.received >= MIN_WINDOW
        assert granted or after == before
        before = after
    assert credit.received == sum(size for size, _, _ in frames)
    room = before - credit.received
    assert room > 0 or credit.take(-room + 1, now_s, None)  # what was allowed earns more
