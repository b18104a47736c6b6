"""What goes on board where PX4 judges it in its own way; MAVSDK's part is played."""

import asyncio
import dataclasses
import struct
from types import SimpleNamespace

import pytest
from mavsdk.plugins.geofence.geofence import GeofenceResult
from mavsdk.plugins.mission_raw.mission_raw import MissionRawResult

from air_router.errors import PlanKeptError, PlanRefusedError
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.px4 import px4_plan, px4_requests
from air_router.vehicle.px4.mavlink_values import FENCE, MISSION, RALLY, MavCmd
from air_router.vehicle.px4.mavsdk_bridge import to_raw
from air_router.vehicle.px4.plan_guard import PlanIds
from air_router.vehicle.px4.px4_connection import Plugins
from air_router.vehicle.px4.px4_events import (
    ARMING_SUMMARY,
    HEALTH_SUMMARY,
    ArmingReports,
    Px4Event,
    event_id,
)
from air_router.vehicle.px4.px4_plan import OnboardPlan
from air_router.vehicle.px4.px4_reports import PlanReport
from air_router.vehicle.vehicle import FlightMode


def identity(items):
    """What PX4 distinguishes one mission from another by."""
    return [(item.command, item.x, item.y, item.z) for item in items]


def number_of(items):
    """By which it distinguishes one list from another; 0: it is empty."""
    return hash(repr(items)) if items else 0


class Board:
    """A PX4 as MAVSDK shows it: it judges a mission only if it is another than before."""

    def __init__(self, *, good=True, reports_state=True, judges_after=0, result_first=False):
        self.good = good
        self.result_first = result_first  # MAVSDK's result is read before our MISSION_ACK
        self.unread = []  # such answers
        self.reports_state = reports_state  # in MISSION_CURRENT, as from PX4 1.17 on
        self.judges_after = judges_after  # so many reports of its arming checks
        self.reports = ArmingReports()
        self.identity, self.time_s = SimpleNamespace(version="1.16.2"), 0.0
        self.mission_state = int(reports_state)
        self.refusals = []
        self.items, self.fence, self.rally = [], [], []
        self.uploads = 0
        self.judged = None
        self.differences = []  # what was different from the plan that we put on board
        self.after_read = lambda: None
        self.in_air = False
        self.sends_mode = True
        self.mode = FlightMode.HOLD
        self.sends_ids = False  # as an older PX4, which sends none
        self.plan = PlanReport()
        self.tried = 0
        self.after = lambda _kind: None  # called after each list that was stored
        self.report()

    def onboard(self):
        return OnboardPlan(Plugins(self, self, self), self, self.received, self.differences.append)

    async def received(self):
        return self.sends_mode

    def forget_texts(self):
        self.refusals.clear()

    def texts(self):
        return ""

    def guard_plan(self, ids):
        self.plan.guard.begin(ids)
        self.guarded = ids

    def plan_refused(self):
        self.tried += 1

    def numbered(self):
        """From now on it sends ids, as PX4 does since 1.15."""
        self.sends_ids = True
        self.report()

    def report(self):
        """Its MISSION_CURRENT."""
        numbers = map(number_of, (self.items, self.fence, self.rally))
        ids = zip(PlanIds._fields, numbers, strict=True) if self.sends_ids else ()
        fields = {"seq": 0, "total": len(self.items), "mission_state": self.mission_state}
        self.plan.take({**fields, **dict(ids)})

    async def shows(self, condition, _limit_s):
        if condition():
            return True
        for _ in range(10):
            self.time_s += 1.0
            while self.unread:
                self.plan.guard.stored(*self.unread.pop(0))
            self.report()
            await asyncio.sleep(0)
            if condition():
                return True
        return False

    async def request_result(self, command, *, limit_s):
        assert command == MavCmd.RUN_PREARM_CHECKS
        if self.left is not None:
            runs = self.good and self.items and self.left <= 0
            self.left -= 1
            modes = 0x7F3BB8 if runs else 0x7F3BB0
            summary = struct.pack("<BIIII", 0, 0, 0, modes, modes)
            self.reports.take(Px4Event(event_id(ARMING_SUMMARY), 7, summary))
            self.reports.take(Px4Event(event_id(HEALTH_SUMMARY), 7))
        return 0

    def upload_mission_async(self, items, answer):
        self.uploads += 1
        self.items = items
        if self.judged != identity(items):
            self.judged = identity(items)
            self.mission_state = (2 if self.good else 1) if self.reports_state else 0
            self.left = self.judges_after
            self.refusals += [] if self.good else ["plan item 3 lies in a no-fly zone"]
        self._stored(MISSION, items)
        answer(MissionRawResult.SUCCESS, None)

    def _stored(self, kind, items):
        if self.sends_ids and self.result_first:
            self.unread.append((kind, number_of(items)))
        elif self.sends_ids:
            self.plan.guard.stored(kind, number_of(items))
        self.after(kind)

    def clear_mission_async(self, answer):
        self.items, self.judged = [], None
        answer(MissionRawResult.SUCCESS, None)

    def upload_geofence_async(self, items, answer):
        self.fence = items
        self._stored(FENCE, items)
        answer(MissionRawResult.SUCCESS, None)

    def clear_geofence_async(self, answer):
        self.fence = []
        self._stored(FENCE, [])
        answer(GeofenceResult.SUCCESS, None)

    def upload_rally_points_async(self, items, answer):
        self.rally = items
        self._stored(RALLY, items)
        answer(MissionRawResult.SUCCESS, None)

    def download_mission_async(self, answer):
        answer(MissionRawResult.SUCCESS, self.items, None)
        self.after_read()

    def download_geofence_async(self, answer):
        answer(MissionRawResult.SUCCESS, self.fence, None)

    def download_rallypoints_async(self, answer):
        answer(MissionRawResult.SUCCESS, self.rally, None)


def test_nothing_is_put_on_board_while_no_flight_mode_of_now_is_received(pennovation):
    board = Board()
    board.sends_mode = False
    with pytest.raises(PlanRefusedError, match="no current flight mode was received"):
        asyncio.run(board.onboard().upload(FlightPlan.of(pennovation)))
    assert (board.uploads, board.fence, board.rally) == (0, [], [])


def test_the_mode_is_requested_before_each_list_that_is_put_on_board(pennovation):
    """A pilot who took the vehicle between two lists shows in it, and the objection knows."""
    board, taken, requests = Board(), [], []

    async def received():
        requests.append((bool(board.fence), bool(board.rally), board.uploads))
        if board.fence:
            taken.append("the pilot has it")
        return True

    board.received = received
    plan = FlightPlan.of(pennovation)
    board.items = [to_raw(n, item, 0) for n, item in enumerate(plan.items)]
    board.rally = [to_raw(n, item, px4_plan.RALLY) for n, item in enumerate(plan.rally[:-1])]
    onboard = board.onboard()
    take = board.upload_rally_points_async

    def rally(items, answer):
        board.fence = ["drawn meanwhile"]
        take(items, answer)

    board.upload_rally_points_async = rally
    onboard = board.onboard()
    with pytest.raises(PlanRefusedError, match="the pilot has it"):
        asyncio.run(onboard.renew(plan, lambda: taken[0] if taken else None))
    assert board.fence == ["drawn meanwhile"]


def test_the_same_mission_that_was_found_wrong_at_power_on_is_judged_anew(pennovation):
    plan, board = FlightPlan.of(pennovation), Board()
    board.judged = identity([to_raw(n, item, 0) for n, item in enumerate(plan.items)])
    asyncio.run(board.onboard().upload(plan))
    assert (board.uploads, board.mission_state) == (2, 2)


def test_a_mission_that_is_wrong_is_refused_with_its_reason_at_once(pennovation):
    board = Board(good=False)
    with pytest.raises(PlanRefusedError, match="plan item 3 lies in a no-fly zone"):
        asyncio.run(board.onboard().upload(FlightPlan.of(pennovation)))
    assert board.uploads == 1


@pytest.mark.parametrize("numbered", [False, True])
@pytest.mark.parametrize("what", ["geofence", "rally_points", "mission"])
def test_what_px4_did_not_keep_is_noticed_before_take_off(pennovation, what, numbered):
    """One that sends no ids is read back list by list; one that sends them, in the end."""
    board = Board()
    if numbered:
        board.numbered()
    take = getattr(board, f"upload_{what}_async")
    setattr(board, f"upload_{what}_async", lambda items, answer: take(items[:-1], answer))
    with pytest.raises(PlanRefusedError, match=r"\d+ items sent, \d+ are on board"):
        asyncio.run(board.onboard().upload(FlightPlan.of(pennovation)))


@pytest.mark.parametrize("what", ["fence", "rally"])
def test_what_a_station_stored_where_the_mission_has_nothing_is_another_plan(pennovation, what):
    plan, board = FlightPlan.of(pennovation), Board()
    asyncio.run(board.onboard().upload(plan))
    asyncio.run(board.onboard().recognise(plan))
    without = dataclasses.replace(plan, **{what: ()})
    with pytest.raises(PlanRefusedError, match=r"0 items sent, \d+ are on board"):
        asyncio.run(board.onboard().recognise(without))


class TestAPx4ThatDoesNotReportWhetherAMissionCanBeFlown:
    """Before 1.17 MISSION_CURRENT.mission_state stays 0."""

    @pytest.mark.parametrize("judges_after", [0, 3])
    def test_its_arming_checks_report_it(self, pennovation, judges_after):
        board = Board(reports_state=False, judges_after=judges_after)
        asyncio.run(board.onboard().upload(FlightPlan.of(pennovation)))
        assert board.reports.count == judges_after + 1
        assert board.uploads == 1

    def test_one_that_was_on_board_is_cleared_first_so_that_they_are_of_ours(self, pennovation):
        plan, board = FlightPlan.of(pennovation), Board(reports_state=False)
        cleared, clear = [], board.clear_mission_async
        board.clear_mission_async = lambda answer: (cleared.append(board.uploads), clear(answer))
        asyncio.run(board.onboard().upload(plan))
        assert cleared == [0]

    def test_a_refusal_has_its_reason(self, pennovation):
        board = Board(good=False, reports_state=False)
        with pytest.raises(PlanRefusedError, match="plan item 3 lies in a no-fly zone"):
            asyncio.run(board.onboard().upload(FlightPlan.of(pennovation)))

    def test_no_report_is_no_refusal_and_its_error_has_that(self, pennovation, monkeypatch):
        monkeypatch.setattr(px4_plan, "PLAN_CHECKS_S", 0.01)
        monkeypatch.setattr(px4_requests, "ARMING_REPORT_S", 0.001)
        board = Board(reports_state=False, judges_after=None)
        with pytest.raises(PlanRefusedError, match="neither MISSION_CURRENT nor a report"):
            asyncio.run(board.onboard().upload(FlightPlan.of(pennovation)))

    def test_a_changed_fence_is_waited_for_until_the_checks_are_of_it(self, pennovation):
        plan, board = FlightPlan.of(pennovation), Board(reports_state=False)
        onboard = board.onboard()
        asyncio.run(onboard.upload(plan))
        sent_s = []
        upload, request = board.upload_geofence_async, board.request_result
        changed = onboard.fence._replace(
            upload=lambda items, answer: (sent_s.append(board.time_s), upload(items, answer))
        )
        onboard.fence = changed
        requested_s = []

        async def request_then(command, *, limit_s):
            requested_s.append(board.time_s)
            return await request(command, limit_s=limit_s)

        board.request_result = request_then
        asyncio.run(onboard.renew(plan, lambda: None))
        assert requested_s[0] - sent_s[0] >= px4_plan.PLAN_RELOAD_S


def test_a_list_that_an_item_of_the_one_before_broke_off_is_sent_again(pennovation, monkeypatch):
    monkeypatch.setattr(px4_plan, "PLAN_BUSY_S", 0.0)
    plan, board = FlightPlan.of(pennovation), Board()
    take, answers = board.upload_rally_points_async, [MissionRawResult.PROTOCOL_ERROR]

    def take_late(items, answer):
        if answers:
            answer(answers.pop(), None)
        else:
            take(items, answer)

    board.upload_rally_points_async = take_late
    asyncio.run(board.onboard().upload(plan))
    assert len(board.rally) == len(plan.rally) > 0


def test_a_link_that_is_gone_while_rally_points_are_cleared_is_no_crash(pennovation):
    plan, board = FlightPlan.of(pennovation), Board()
    board.rally = [to_raw(0, plan.rally[0], px4_plan.RALLY)]
    board.send = lambda _name, _fields: "CONNECTION_ERROR"
    with pytest.raises(PlanRefusedError, match="CONNECTION_ERROR"):
        asyncio.run(board.onboard().renew(dataclasses.replace(plan, rally=()), lambda: None))


@pytest.mark.parametrize("first", [True, False])
def test_rally_points_that_we_have_cleared_are_not_anothers_change(pennovation, first):
    """PX4 clears them at the last request, and what it answers is lost."""
    plan, board, requests = FlightPlan.of(pennovation), Board(), []
    board.numbered()

    def clear(name, _fields):
        requests.append(name)
        if len(requests) == px4_plan.PLAN_BUSY_ATTEMPTS:
            board.rally = []

    board.send = clear
    board.rally = [to_raw(0, plan.rally[0], RALLY)]
    board.report()
    onboard = board.onboard()
    if not first:
        asyncio.run(onboard.upload(plan))
    without = dataclasses.replace(plan, rally=())
    asyncio.run(onboard.upload(without) if first else onboard.renew(without, lambda: None))
    assert requests == ["MISSION_CLEAR_ALL"] * px4_plan.PLAN_BUSY_ATTEMPTS
    board.report()
    assert board.plan.guard.changed == frozenset()


def test_a_list_whose_transfer_is_not_waited_for_is_not_anothers_change(pennovation):
    """It was stored, and neither the answer nor the result was received in time."""

    async def script():
        plan, board, stored = FlightPlan.of(pennovation), Board(), asyncio.Event()
        board.numbered()
        onboard = board.onboard()
        await onboard.upload(plan)

        def store(items, _answer):
            board.fence = items
            stored.set()

        onboard.fence = onboard.fence._replace(upload=store)
        other = dataclasses.replace(plan, fence=plan.fence[:-4])
        renewal = asyncio.ensure_future(onboard.renew(other, lambda: None))
        await stored.wait()
        renewal.cancel()
        await asyncio.wait({renewal})
        assert renewal.cancelled()
        assert len(board.fence) == len(other.fence)
        board.report()
        return board.plan.guard.changed

    assert asyncio.run(script()) == frozenset()


@pytest.mark.parametrize("lost", [0, 1])
def test_a_plan_that_changes_while_it_is_compared_is_compared_again(pennovation, lost):
    async def script():
        plan, board = FlightPlan.of(pennovation), Board()
        onboard = board.onboard()
        await onboard.upload(plan)
        whole, board.items = board.items, board.items[:-1]

        def change():
            board.after_read = lambda: None
            board.items = whole[: len(whole) - lost]
            onboard.replaced()

        board.after_read = change
        onboard.replaced()
        await onboard._comparing
        return board.differences, len(plan.items)

    (difference,), items = asyncio.run(script())
    wanted = f"the mission: {items} items sent, {items - 1} are on board" if lost else None
    assert difference == wanted


@pytest.mark.parametrize("begun", [False, True])
def test_a_renewal_that_has_sent_nothing_leaves_the_plan_on_board_and_its_error_shows_that(
    pennovation, begun
):
    plan, board = FlightPlan.of(pennovation), Board()
    onboard = board.onboard()
    asyncio.run(onboard.upload(plan))

    def answers(kind):
        board.sends_mode = kind != RALLY

    board.sends_mode, board.after = begun, answers
    other = dataclasses.replace(plan, fence=plan.fence[:-4], rally=plan.rally[:-1])
    with pytest.raises(PlanRefusedError, match="no current flight mode was received") as caught:
        asyncio.run(onboard.renew(other, lambda: None))
    assert isinstance(caught.value, PlanKeptError) is not begun


@pytest.mark.parametrize("before", [1, 2, 3])
def test_what_is_objected_to_is_not_put_on_board_any_more(pennovation, before):
    plan, board = FlightPlan.of(pennovation), Board()
    onboard, begun = board.onboard(), []
    asyncio.run(onboard.upload(plan))
    for name in ("upload_geofence_async", "upload_rally_points_async", "upload_mission_async"):
        begin = getattr(board, name)
        setattr(board, name, lambda *given, begin=begin: (begun.append(1), begin(*given)))
    onboard.mission, onboard.fence, onboard.rally = (
        of._replace(upload=getattr(board, f"upload_{kind}_async"))
        for of, kind in (
            *((onboard.mission, "mission"), (onboard.fence, "geofence")),
            (onboard.rally, "rally_points"),
        )
    )
    other = dataclasses.replace(plan, items=plan.items[:-1], rally=plan.rally[:-1])
    clear = board.clear_geofence_async
    board.clear_geofence_async = lambda answer: (begun.append(1), clear(answer))
    with pytest.raises(PlanRefusedError, match="a pilot has it"):
        asyncio.run(
            onboard.renew(other, lambda: "a pilot has it" if len(begun) >= before else None)
        )
    assert len(begun) == before
    asyncio.run(onboard.upload(plan))


def test_a_plan_that_is_not_waited_for_any_more_reads_nothing_and_leaves_the_watch(pennovation):
    plan, board = FlightPlan.of(pennovation), Board()
    onboard = board.onboard()
    asyncio.run(onboard.upload(plan))
    board.guarded = "ours"
    board.after_read = lambda: pytest.fail("the link is needed for the way home")
    with pytest.raises(PlanRefusedError, match="the mission goes on without it"):
        asyncio.run(onboard.renew(plan, lambda: "the mission goes on without it"))
    assert board.guarded == "ours"


@pytest.mark.parametrize("result_first", [True, False])
def test_our_lists_are_ours_whether_their_answer_or_the_result_comes_first(
    pennovation, result_first
):
    plan, board = FlightPlan.of(pennovation), Board(result_first=result_first)
    board.numbered()
    onboard = board.onboard()
    asyncio.run(onboard.upload(plan))
    shorter = dataclasses.replace(plan, fence=plan.fence[:-4], rally=plan.rally[:-1])
    asyncio.run(onboard.renew(shorter, lambda: None))
    assert len(board.fence) == len(shorter.fence)
    assert board.plan.guard.changed == frozenset()


@pytest.mark.parametrize("result", [MissionRawResult.SUCCESS, MissionRawResult.TIMEOUT])
def test_a_mission_that_we_have_cleared_is_not_anothers_change(pennovation, result):
    """On a PX4 before 1.17 one that is on board is cleared first; what it answers may be lost."""
    plan, board = FlightPlan.of(pennovation), Board(reports_state=False)
    board.items = [to_raw(n, item, 0) for n, item in enumerate(plan.items[:-1])]
    board.numbered()
    clear = board.clear_mission_async
    board.clear_mission_async = lambda answer: clear(lambda *_: answer(result, None))
    asyncio.run(board.onboard().upload(plan))
    assert len(board.items) == len(plan.items)


@pytest.mark.parametrize(
    ("ids", "result_first"),
    [(True, True), (True, False), (False, False)],  # an older PX4 sends none: it is read back
)
@pytest.mark.parametrize("after", [FENCE, RALLY])
@pytest.mark.parametrize("first", [True, False])
def test_what_another_station_changes_meanwhile_is_written_over_by_no_list(
    pennovation, ids, result_first, after, first
):
    """From the first list to the last, in the first upload and when the plan is renewed."""
    plan, board = FlightPlan.of(pennovation), Board(result_first=result_first)
    onboard = board.onboard()
    if ids:
        board.numbered()
    if not first:
        asyncio.run(onboard.upload(plan))
    theirs = [*board.fence[:4]]

    def change(kind):
        if kind == after:
            board.fence, theirs[:] = board.fence[:5], board.fence[:5]

    board.after = change
    other = dataclasses.replace(plan, fence=plan.fence[:-4], rally=plan.rally[:-1])
    transfer = onboard.upload(plan) if first else onboard.renew(other, lambda: None)
    with pytest.raises(PlanRefusedError):
        asyncio.run(transfer)
    assert board.fence == theirs


def test_a_plan_that_was_changed_before_its_renewal_is_not_written_over(pennovation):
    plan, board = FlightPlan.of(pennovation), Board()
    onboard = board.onboard()
    board.numbered()
    asyncio.run(onboard.upload(plan))
    uploads, board.items = board.uploads, board.items[:-1]
    other = dataclasses.replace(plan, items=plan.items[:-2])
    with pytest.raises(PlanRefusedError, match="another ground station has changed"):
        asyncio.run(onboard.renew(other, lambda: None))
    assert board.uploads == uploads
    asyncio.run(onboard.renew(other, lambda: None))  # the operator was informed, and wants it
    assert board.uploads == uploads + 1


def test_that_px4_is_busy_with_a_transfer_of_another_is_reported(pennovation, monkeypatch):
    monkeypatch.setattr(px4_plan, "PLAN_BUSY_S", 0.0)
    plan, board = FlightPlan.of(pennovation), Board()
    onboard = board.onboard()
    upload, refused = onboard.fence.upload, [1]

    def begin(items, answer):
        if refused:
            refused.pop()
            answer(MissionRawResult.ERROR, None)
        else:
            upload(items, answer)

    onboard.fence = onboard.fence._replace(upload=begin)
    asyncio.run(onboard.upload(plan))
    assert board.tried == 1
