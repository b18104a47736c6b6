"""`benchmarks.contention`: real nodes of a team share one channel, as in an experiment."""

import asyncio
import csv
import itertools

import pytest

from benchmarks.contention.__main__ import MEASURES, Pair, csv_text, ratio_of, table
from benchmarks.contention.messages import Cutter
from benchmarks.contention.planned import Meeting, Planned, Publication, planned, tasks_of
from benchmarks.contention.replay import replay
from mocha_link.node.zmtp import COMMAND, READY, ZmtpSession, metadata
from sitl.experiment import RunSettings
from sitl.experiment.robots import fleet_of
from sitl.experiment.settings import PaperModel

QUICK = PaperModel(header_rate_1_s=200, data_rate_1_s=200, end_rate_1_s=200)


@pytest.mark.parametrize("step", [1, 7, 64, 100_000])
def test_a_connection_is_cut_into_what_crosses_as_a_whole(step):
    end = ZmtpSession(1 << 20)
    command = READY + metadata(b"REQ")
    sent = [end.hello[:64], bytes((COMMAND, len(command))) + command]
    bodies = [b"short", bytes(300), b""]
    sent += [end.request(body) for body in bodies]
    stream, cutter = b"".join(sent), Cutter()
    pieces = [
        piece for at in range(0, len(stream), step) for piece in cutter.feed(stream[at : at + step])
    ]
    assert [piece.raw for piece in pieces] == sent
    assert [piece.body for piece in pieces] == [None, None, *bodies]


def plan(*events, paper=QUICK, duration_s=6.0, ugvs=2):
    settings = RunSettings(ugvs=ugvs, paper=paper, duration_s=duration_s, protocol="original")
    team = fleet_of(1, ugvs, base=False, original=True).team
    return Planned("made up", settings, 1, team, events, {})


def test_real_nodes_take_turns_and_messages_go_on_to_the_third():
    published = [Publication(0.0, name, "/pose", b"{}") for name in ("uav01", "ugv01", "ugv02")]
    met = [Meeting(1.0, "uav01", "ugv01", up=True), Meeting(1.0, "uav01", "ugv02", up=True)]
    again = [Meeting(5.0, "uav01", "ugv02", up=False), Meeting(5.5, "uav01", "ugv02", up=True)]
    found = asyncio.run(replay(plan(*published, *met, *again, duration_s=10.0)))
    measures = found.measures
    assert measures["exchanges_broken"] == 0
    assert measures["exchanges_complete"] == 6
    assert measures["exchanges_open"] == 0
    in_order = sorted(found.transmissions, key=lambda sent: sent.start_s)
    assert all(first.end_s <= then.start_s for first, then in itertools.pairwise(in_order))
    assert {sent.answering for sent in in_order if sent.requesting == 2} == {0}  # it never meets 1
    assert sum(sent.messages for sent in in_order if sent.requesting == 2) == 2  # the poses of both


def test_contact_that_is_lost_cuts_what_is_on_the_air_and_then_ends_the_pull():
    slow = PaperModel(header_rate_1_s=1e-3, timeout_s=1.0)
    met = [Meeting(0.0, "uav01", "ugv01", up=True), Meeting(1.0, "uav01", "ugv01", up=False)]
    found = asyncio.run(replay(plan(*met, paper=slow, duration_s=5.0, ugvs=1)))
    assert found.measures["exchanges_complete"] == 0
    assert found.measures["exchanges_broken"] == 2
    assert not any(sent.complete for sent in found.transmissions)


def test_a_node_that_ends_is_an_error_of_the_run():
    wrong = Publication(0.5, "ugv01", "/no_topic_of_the_team", b"")
    with pytest.raises(RuntimeError, match="a node has ended"):
        asyncio.run(replay(plan(wrong, duration_s=3.0, ugvs=1)))


def test_what_a_run_publishes_does_not_depend_on_when_the_channel_is_free():
    (task,) = tasks_of("table1", ["radius_m=30", "ugvs=3", "uavs=1"], range(1, 2))
    one = planned(task, 60.0)
    times = {event.at_s for event in one.events if isinstance(event, Publication)}
    assert all(at_s == round(at_s) for at_s in times)
    assert any(isinstance(event, Meeting) for event in one.events)
    assert one.measures["waits"] > 0
    assert planned(task, 60.0).events == one.events


def test_the_ratio_is_of_pairs_and_leaves_out_runs_without_the_measure():
    pairs = [
        Pair("a team", seed, dict.fromkeys(MEASURES, 2.0 * seed), dict.fromkeys(MEASURES, own), 0.0)
        for seed, own in enumerate([2.0, 4.0, 3.0])
    ]
    found = ratio_of("waits", pairs)
    assert found.value == pytest.approx((4 / 2 * 3 / 4) ** 0.5)
    assert found.low < found.value < found.high
    assert "| messages | 2.83 | 3.46 | 1.22 (" in table(pairs)
    head, *lines = csv.reader(csv_text(pairs).splitlines())
    assert head[:4] == ["row", "seed", "waits experiment", "waits nodes"]
    assert [line[:4] for line in lines][1:] == [
        ["a team", "1", "2", "4"],
        ["a team", "2", "4", "3"],
    ]
