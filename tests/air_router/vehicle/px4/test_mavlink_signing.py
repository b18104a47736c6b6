"""MAVLink's signatures, with pymavlink at the other end of the link."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from air_router.vehicle.px4.limits import SIGNING_NEW_SENDER_S, SIGNING_RESERVED_S
from air_router.vehicle.px4.mavlink_frame import frames_of, header_of
from air_router.vehicle.px4.mavlink_signing import (
    MavlinkSigner,
    SignedStream,
    Verdict,
    timestamp_of,
)
from air_router.vehicle.px4.mavlink_values import SIGNING_EPOCH_UNIX_S, SIGNING_UNIT_S
from air_router.vehicle.px4.signing_key import SigningKey

KEY, OTHER = SigningKey(bytes(range(1, 33))), SigningKey(bytes(range(2, 34)))
NOW_S = SIGNING_EPOCH_UNIX_S + 3.5e8
VEHICLE = 7  # system id


class Clock:
    def __init__(self, unix_s=NOW_S):
        self.unix_s = unix_s

    def __call__(self):
        return self.unix_s


def signer(key=KEY, last=0, clock=None, **options):
    return MavlinkSigner(key, VEHICLE, last, unix_s=clock or Clock(), **options)


class Sender:
    """A vehicle or a station, as pymavlink signs."""

    def __init__(self, key=KEY, unix_s=NOW_S, *, component=1, link_id=0):
        self.mav = mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=component)
        self.mav.signing.secret_key = key.secret
        self.mav.signing.link_id = link_id
        self.mav.signing.timestamp = timestamp_of(unix_s)

    def heartbeat(self, *, signed=True, version=2, custom_mode=0):
        self.mav.signing.sign_outgoing = signed
        message = mavlink.MAVLink_heartbeat_message(2, 12, 128, custom_mode, 4, 3)
        return bytes(message.pack(self.mav, force_mavlink1=version == 1))


def radio_status():
    link = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    return bytes(mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7).pack(link))


def plain(frame):
    """Whether pymavlink takes it as an unsigned frame, its checksum included."""
    (message,) = mavlink.MAVLink(None).parse_buffer(frame)
    return message.get_type() != "BAD_DATA" and not message.get_signed()


def receiver(key=KEY):
    """pymavlink's other end, which takes nothing that is not signed with the key."""
    link = mavlink.MAVLink(None)
    link.robust_parsing = True
    link.signing.secret_key = key.secret
    link.signing.timestamp = timestamp_of(NOW_S)
    return link


def types(link, data):
    return [message.get_type() for message in link.parse_buffer(data) or []]


def orders():
    """Two messages in one piece, as MAVSDK may send them."""
    link = mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=191)
    order = mavlink.MAVLink_command_long_message(VEHICLE, 1, 176, 0, 1, 4, 6, 0, 0, 0, 0)
    return bytes(order.pack(link)) + bytes(mavlink.MAVLink_timesync_message(0, 1 << 60).pack(link))


def test_what_leaves_is_taken_by_pymavlink_with_the_same_key_only():
    ours = signer()
    link = receiver()
    for _ in range(3):
        assert types(link, ours.sign(orders())) == ["COMMAND_LONG", "TIMESYNC"]
    assert set(types(receiver(OTHER), ours.sign(orders()))) == {"BAD_DATA"}


def test_what_cannot_be_signed_does_not_leave():
    ours, sender = signer(), Sender()
    assert ours.sign(sender.heartbeat(signed=False, version=1)) == b""
    assert ours.sign(sender.heartbeat()) == b""  # it has a signature
    whole, broken = orders(), orders()[:-1]
    assert len(list(frames_of(ours.sign(whole)))) == 2
    assert len(list(frames_of(ours.sign(broken)))) == 1


def test_what_pymavlink_signs_is_taken_without_its_signature():
    ours, sender = signer(), Sender()
    taken = ours.received(sender.heartbeat() + sender.heartbeat())
    assert [header_of(frame) for frame in frames_of(taken)] == [(VEHICLE, 1, 0)] * 2
    assert all(map(plain, frames_of(taken)))
    assert (ours.counts, ours.posing) == ({Verdict.GOOD: 2}, 0)


def test_unsigned_messages_are_not_taken_but_that_of_a_radio():
    ours, sender = signer(), Sender()
    for version in (1, 2):
        assert ours.received(sender.heartbeat(signed=False, version=version)) == b""
    assert ours.received(radio_status()) == radio_status()
    assert ours.counts == {Verdict.UNSIGNED: 2, Verdict.EXEMPT: 1}
    assert ours.posing == 2


def test_a_radio_whose_message_is_damaged_is_not_taken():
    damaged = radio_status()[:-3] + b"\x99" + radio_status()[-2:]
    assert signer().received(damaged) == b""


def test_another_key_is_not_taken_and_moves_no_time():
    ours = signer()
    later = Sender(OTHER, NOW_S + 1e6)
    assert ours.received(later.heartbeat()) == b""
    assert (ours.counts, ours.posing) == ({Verdict.FORGED: 1}, 1)
    assert ours.received(Sender().heartbeat())  # the genuine one of now


@given(at=st.integers(1, 9 + 9 + 2 + 13), bit=st.integers(0, 7))
def test_a_changed_bit_is_found(at, bit):
    frame = bytearray(Sender().heartbeat())
    at %= len(frame)
    frame[at] ^= 1 << bit
    assert signer().received(bytes(frame)) == b""


@given(length=st.integers(0, 33))
def test_a_truncated_frame_is_not_taken(length):
    frame = Sender().heartbeat()
    assert signer().received(frame[: min(length, len(frame) - 1)]) == b""


@given(data=st.binary(max_size=600))
def test_noise_is_not_taken(data):
    ours = signer()
    assert ours.received(data) == SignedStream(ours).received(data) == b""


def test_a_replay_is_not_taken():
    ours, sender = signer(), Sender()
    first, second = sender.heartbeat(), sender.heartbeat()
    assert ours.received(second)
    assert ours.received(second) == ours.received(first) == b""
    assert (ours.counts[Verdict.OLD], ours.posing) == (2, 0)
    assert ours.received(sender.heartbeat())


def test_components_and_links_have_times_of_their_own():
    ours = signer()
    for link_id in (0, 1):
        for component in (1, 190):
            sender = Sender(component=component, link_id=link_id)
            assert ours.received(sender.heartbeat())


@pytest.mark.parametrize(
    ("age_s", "taken"), [(SIGNING_NEW_SENDER_S, True), (SIGNING_NEW_SENDER_S + 1.0, False)]
)
def test_a_new_sender_may_be_a_minute_behind(age_s, taken):
    ours = signer()
    assert bool(ours.received(Sender(unix_s=NOW_S - age_s).heartbeat())) is taken
    assert ours.stale_heartbeat is not taken


def test_a_vehicle_that_has_restarted_is_taken_once_it_goes_by_our_time():
    """PX4 begins with the time at which it got the key, until it takes a message of ours."""
    ours, sender = signer(), Sender(unix_s=NOW_S - 1e7)
    assert ours.received(sender.heartbeat()) == b""
    assert ours.stale_heartbeat
    assert ours.received(Sender(OTHER, NOW_S - 1e7).heartbeat()) == b""
    assert not ours.stale_heartbeat
    sender.mav.robust_parsing = True
    assert types(sender.mav, ours.sign(orders())) == ["COMMAND_LONG", "TIMESYNC"]
    assert ours.received(sender.heartbeat())


def timestamps(data):
    return [int.from_bytes(frame[-12:-6], "little") for frame in frames_of(data)]


def test_times_rise_with_each_frame_also_where_the_clock_is_set_back():
    clock = Clock()
    ours = signer(clock=clock)
    first = timestamps(ours.sign(orders()))
    clock.unix_s -= 1e6
    second = timestamps(ours.sign(orders()))
    assert first + second == [timestamp_of(NOW_S) + n for n in range(4)]


def test_our_time_is_that_of_the_vehicle_where_our_clock_is_behind():
    ours = signer(clock=Clock(0.0))
    assert ours.received(Sender().heartbeat())
    assert timestamps(ours.sign(orders()))[0] == timestamp_of(NOW_S) + 1


def test_times_never_go_back_over_restarts_with_a_clock_that_begins_anew():
    stored = []
    clock = Clock()
    ours = signer(clock=clock, store=stored.append)
    used = []
    for _ in range(100):
        clock.unix_s += 1.0
        used += timestamps(ours.sign(orders()))
        assert used[-1] <= stored[-1]  # also if the program is killed now
    assert len(stored) < 10
    killed = signer(last=stored[-1], clock=Clock(0.0))
    assert timestamps(killed.sign(orders()))[0] > used[-1]
    assert stored[-1] - used[-1] <= SIGNING_RESERVED_S / SIGNING_UNIT_S
    ours.close()
    assert stored[-1] == used[-1]  # it ends without a loss


@pytest.mark.parametrize("timestamp", [(1 << 47) - 1, 1 << 47, (1 << 48) - 2])
def test_times_that_are_as_late_as_they_can_be_stop_nothing(timestamp):
    """Their sender has the key; the flight goes on all the same."""
    ours, sender = signer(), Sender()
    sender.mav.signing.timestamp = timestamp
    assert bool(ours.received(sender.heartbeat())) is (timestamp < 1 << 47)
    assert len(timestamps(ours.sign(orders()))) == 2
    assert len(timestamps(signer(clock=Clock(1e12)).sign(orders()))) == 2


def test_a_stream_is_cut_where_frames_begin_whatever_the_pieces():
    ours, sender = signer(), Sender()
    frames = [sender.heartbeat() for _ in range(4)]
    more = [sender.heartbeat() for _ in range(9)]  # behind what seems to be a long frame
    stream = b"noise\xfd" + frames[0] + frames[1][:-3] + frames[2] + radio_status() + frames[3]
    stream += b"".join(more)
    cut = SignedStream(ours)
    taken = b"".join(cut.received(bytes((byte,))) for byte in stream)
    ids = [header_of(frame).message_id for frame in frames_of(taken)]
    assert ids == [0, 0, 109, 0, *[0] * 9]
    assert ours.counts[Verdict.GOOD] == 12
    assert cut.received(frames[2]) == b""  # a replay


def test_a_frame_in_a_stream_that_is_not_taken_counts_once():
    ours, sender = signer(), Sender()
    # Within it other frames seem to begin, of MAVLink 1 and of no length.
    unsigned = sender.heartbeat(signed=False, custom_mode=0xFE00FE)
    cut = SignedStream(ours)
    assert cut.received(unsigned * 3 + sender.heartbeat())
    assert ours.counts[Verdict.UNSIGNED] == 3
    assert ours.posing == 3


@pytest.mark.parametrize(
    ("sender", "words"),
    [
        (lambda: Sender(OTHER).heartbeat(), "signed with another key"),
        (lambda: Sender().heartbeat(signed=False), "is not signed"),
        (lambda: Sender(unix_s=NOW_S - 1e6).heartbeat(), "with old timestamps"),
        (lambda: b"", ""),
    ],
)
def test_the_reason_why_nothing_is_taken_is_reported(sender, words):
    ours = signer()
    ours.received(sender())
    assert words in ours.why_none_is_taken
    assert bool(ours.why_none_is_taken) == bool(words)


def test_the_key_does_not_show():
    assert KEY.secret.hex() not in repr(KEY)
    assert repr(KEY.secret) not in repr(KEY)
