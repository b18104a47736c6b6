"""Who may hand on whose messages."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest

from mocha_link.store import wire
from mocha_link.store.trust import SignatureError, Verifier, sign
from mocha_link.store.wire import Header, PayloadError
from mocha_link.team.keys import SecretKey
from mocha_link.team.team import Team, Trust
from tests.mocha_link.original import packed

STAMP_MS = 1_795_175_905_123
TITAN, IO = SecretKey(b"t" * 32), SecretKey(b"i" * 32)


@pytest.fixture
def mixed(team) -> Team:
    """titan and io have keys, callisto runs the original node."""
    return team.with_robots(
        {
            "titan": {"key": TITAN.public.text},
            "io": {"key": IO.public.text},
            "callisto": {"original": True},
        }
    )


def message(  # noqa: PLR0913 - every part of a message
    team: Team,
    robot: str,
    topic: str = "/map",
    *,
    by: SecretKey | None = None,
    stamp_ms: int | None = STAMP_MS,
    data: bytes = b"data",
) -> tuple[Header, bytes]:
    known = team.topic(robot, topic)
    signs = partial(sign, by, team.robot(robot), known) if by else None
    body = packed(known.dtype, known.priority, data)
    if stamp_ms is not None:
        body = wire.pack(known.dtype, known.priority, data, stamp_ms=stamp_ms, sign=signs)
    header = Header.at(team.robot(robot).robot_id, known.topic_id, stamp_ms or STAMP_MS)
    return header, body


def verify(team: Team, header: Header, body: bytes, handed_by: str) -> None:
    Verifier(team).verify(header, body, wire.check(body), handed_by=handed_by)


@pytest.mark.parametrize("handed_by", ["titan", "io", "callisto"])
def test_what_is_not_signed(mixed, handed_by):
    for stamp_ms in (STAMP_MS, None):  # with a trailer, and without one
        unsigned = message(mixed, "titan", stamp_ms=stamp_ms)
        verify(mixed, *unsigned, handed_by)
        with pytest.raises(SignatureError, match=f"not signed by titan, handed on by {handed_by}"):
            verify(replace(mixed, trust=Trust.SIGNED), *unsigned, handed_by)


def test_robots_without_a_key(mixed):
    original = message(mixed, "callisto", "/pose", stamp_ms=None)
    for handed_by in ("callisto", "titan", "io"):
        verify(mixed, *original, handed_by)
    strict = replace(mixed, trust=Trust.SIGNED)
    verify(strict, *original, "callisto")
    with pytest.raises(
        SignatureError, match=r"callisto has no key: .* from itself only, not from io"
    ):
        verify(strict, *original, "io")


@pytest.mark.parametrize("trust", ["relays", "signed"])
def test_a_wrong_signature_is_worse_than_none(mixed, trust):
    team = replace(mixed, trust=Trust(trust))
    for handed_by in ("titan", "io", "callisto"):
        with pytest.raises(SignatureError, match=f"not of titan, handed on by {handed_by}"):
            verify(team, *message(team, "titan", by=IO), handed_by)
    assert issubclass(SignatureError, PayloadError)


def test_a_signature_that_no_key_can_check_counts_as_none(mixed):
    verify(mixed, *message(mixed, "callisto", "/pose", by=IO), "callisto")


def test_a_signature_holds_for_this_message_only(mixed):
    header, body = message(mixed, "titan", by=TITAN)
    signature = wire.check(body).signature
    elsewhere = [
        message(mixed, "titan", "/slow"),
        message(mixed, "titan", stamp_ms=STAMP_MS + 1),
        message(mixed, "titan", stamp_ms=STAMP_MS + 65_536_000),
        message(mixed, "titan", data=b"date"),
    ]
    for other, unsigned in elsewhere:
        known = mixed.by_ids(other.robot_id, other.topic_id)[1]
        forged = wire.pack(
            known.dtype,
            known.priority,
            wire.unpack(unsigned),
            stamp_ms=wire.check(unsigned).stamp_ms,
            sign=lambda _: signature,
        )
        with pytest.raises(SignatureError):
            verify(mixed, other, forged, "io")
    priority = wire.pack(body[0], 0, b"data", stamp_ms=STAMP_MS, sign=lambda _: signature)
    with pytest.raises(SignatureError):
        verify(mixed, header, priority, "io")
    assert wire.pack(body[0], body[1], b"data", stamp_ms=STAMP_MS, sign=lambda _: signature) == (
        body
    )


def test_the_header_cannot_be_another_one(mixed):
    header, body = message(mixed, "titan", by=TITAN)
    for other in (
        replace(header, seconds=header.seconds + 1),
        replace(header, milliseconds=header.milliseconds + 1),
    ):
        with pytest.raises(SignatureError, match="the time of another message"):
            verify(mixed, other, body, "titan")
    with pytest.raises(SignatureError, match="not of titan"):
        verify(mixed, replace(header, topic_id=1), body, "titan")
    with pytest.raises(SignatureError, match="not of io"):
        verify(mixed, replace(header, robot_id=mixed.robot("io").robot_id), body, "io")


def test_another_name_is_another_message(mixed):
    """Ids may mean something else in another team file: the names are signed as well."""
    header, body = message(mixed, "titan", by=TITAN)
    topics = mixed.kinds["aerial_robot"]
    renamed = (topics[0].model_copy(update={"name": "/goal"}), *topics[1:])
    other = replace(mixed, kinds={**mixed.kinds, "aerial_robot": renamed})
    with pytest.raises(SignatureError, match="not of titan"):
        verify(other, header, body, "titan")


def test_what_the_team_does_not_know(mixed):
    header, body = message(mixed, "titan", by=TITAN)
    with pytest.raises(SignatureError, match="not of this team"):
        verify(mixed, replace(header, robot_id=77), body, "titan")
