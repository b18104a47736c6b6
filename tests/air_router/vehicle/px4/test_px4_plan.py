"""What goes on board where PX4 judges it in its own way; MAVSDK's part is played."""

import asyncio
import dataclasses

import pytest
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirectError, MavlinkDirectResult
from mavsdk.plugins.mission_raw.mission_raw import MissionRawResult

from air_router.errors import PlanRefusedError
from air_router.mission.flight_plan import FlightPlan, Frame
from air_router.vehicle.mavlink.px4_connection import Plugins
from air_router.vehicle.px4 import px4_plan
from air_router.vehicle.px4.px4_plan import PlanTransfer
from air_router.vehicle.px4.px4_plan_guard import PlanGuard


def identity(items):
    """What PX4 tells one mission from another by."""
    return [(item.command, item.x, item.y, item.z) for item in items]


class Board:
    """A PX4 as MAVSDK shows it: it judges a mission only if it is another than before."""

    def __init__(self, *, good=True):
        self.good = good
        self.mission_state, self.mission_reports, self.item_total = 1, 0, 0
        self.refusals = []
        self.items, self.fence, self.rally = [], [], []
        self.uploads = 0
        self.judged = None

    def transfer(self):
        return PlanTransfer(Plugins(self, self, self, None), self, 1)

    def forget_words(self):
        self.refusals.clear()

    def said(self):
        return ""

    async def wait_for(self, condition):
        while not condition():
            self.mission_reports += 1
            self.item_total = len(self.items)
            await asyncio.sleep(0)

    def upload_mission_async(self, items, answer):
        self.uploads += 1
        self.items = items
        if self.judged != identity(items):
            self.judged = identity(items)
            self.mission_state = 2 if self.good else 1
            self.refusals += [] if self.good else ["plan item 3 lies in a no-fly zone"]
        answer(MissionRawResult.SUCCESS, None)

    def clear_mission_async(self, answer):
        self.items, self.judged = [], None
        answer(MissionRawResult.SUCCESS, None)

    def upload_geofence_async(self, items, answer):
        self.fence = items
        answer(MissionRawResult.SUCCESS, None)

    def upload_rally_points_async(self, items, answer):
        self.rally = items
        answer(MissionRawResult.SUCCESS, None)

    def download_mission_async(self, answer):
        answer(MissionRawResult.SUCCESS, self.items, None)

    def download_geofence_async(self, answer):
        answer(MissionRawResult.SUCCESS, self.fence, None)

    def download_rallypoints_async(self, answer):
        answer(MissionRawResult.SUCCESS, self.rally, None)


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(px4_plan, "FEASIBLE_S", 0.05)


def test_the_same_mission_that_was_found_wrong_at_power_on_is_judged_anew(pennovation):
    plan, board = FlightPlan.of(pennovation), Board()
    board.judged = identity([px4_plan._to_raw(n, item, 0) for n, item in enumerate(plan.items)])
    asyncio.run(board.transfer().upload(plan))
    assert (board.uploads, board.mission_state) == (2, 2)


def test_a_mission_that_is_wrong_is_refused_with_its_reason_at_once(pennovation):
    board = Board(good=False)
    with pytest.raises(PlanRefusedError, match="plan item 3 lies in a no-fly zone"):
        asyncio.run(board.transfer().upload(FlightPlan.of(pennovation)))
    assert board.uploads == 1


@pytest.mark.parametrize("what", ["geofence", "rally_points", "mission"])
def test_what_px4_did_not_keep_is_noticed_before_take_off(pennovation, what):
    board = Board()
    take = getattr(board, f"upload_{what}_async")
    setattr(board, f"upload_{what}_async", lambda items, answer: take(items[:-1], answer))
    with pytest.raises(PlanRefusedError, match=r"\d+ items sent, \d+ are on board"):
        asyncio.run(board.transfer().upload(FlightPlan.of(pennovation)))


def test_a_list_that_an_item_of_the_one_before_broke_off_is_sent_again(pennovation, monkeypatch):
    monkeypatch.setattr(px4_plan, "BUSY_S", 0.0)
    plan, board = FlightPlan.of(pennovation), Board()
    take, answers = board.upload_rally_points_async, [MissionRawResult.PROTOCOL_ERROR]

    def take_late(items, answer):
        if answers:
            answer(answers.pop(), None)
        else:
            take(items, answer)

    board.upload_rally_points_async = take_late
    asyncio.run(board.transfer().upload(plan))
    assert len(board.rally) == len(plan.rally) > 0


def test_a_link_that_is_gone_while_rally_points_are_cleared_is_no_crash(pennovation):
    def gone(sent):
        raise MavlinkDirectError(MavlinkDirectResult.CONNECTION_ERROR, "send_message()", sent)

    plan, board = FlightPlan.of(pennovation), Board()
    board.rally = [px4_plan._to_raw(0, plan.rally[0], px4_plan.RALLY)]
    board.send_message = gone
    with pytest.raises(PlanRefusedError, match="CONNECTION_ERROR"):
        asyncio.run(board.transfer().renew(dataclasses.replace(plan, rally=())))


def changed(item, **changes):
    return dataclasses.replace(item, **changes)


@pytest.mark.parametrize(
    "change",
    [{"x_deg_e7": 8}, {"y_deg_e7": -9}, {"z_m": 0.09}],
)
def test_what_a_station_rounds_flies_the_same(pennovation, change):
    item = FlightPlan.of(pennovation).items[-1]
    ((name, by),) = change.items()
    assert item.same_as(changed(item, **{name: getattr(item, name) + by}))
    assert not item.same_as(changed(item, **{name: getattr(item, name) + 10 * by}))


def test_frames_that_px4_gives_back_for_others_are_the_same(pennovation):
    item = FlightPlan.of(pennovation).items[-1]
    assert item.same_as(changed(item, frame=Frame.RELATIVE_ALT))
    assert not item.same_as(changed(item, frame=Frame.GLOBAL_INT))
    assert not item.same_as(changed(item, autocontinue=True))


def test_a_plan_that_changes_while_it_is_compared_is_compared_again(pennovation):
    async def script():
        plan, reported, reads = FlightPlan.of(pennovation), [], []

        async def compare(what):
            reads.append(what)
            if len(reads) == 1:
                guard.replaced()  # the fence follows the items
                raise PlanRefusedError("half of it")

        guard = PlanGuard(compare, reported.append)
        guard.plan = plan
        guard.replaced()
        await guard.done()
        return reads == [plan, plan], reported

    assert asyncio.run(script()) == (True, [None])
