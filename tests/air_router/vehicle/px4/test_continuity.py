"""No single message moves the vehicle, and what goes on being said is believed."""

from air_router.vehicle.px4.continuity import MESSAGES, QUIET_S, Continuity, ReportedPosition
from geo.frame import Point

HERE, AWAY = Point(10.0, 0.0), Point(900.0, 0.0)


class Told:
    """Positions at 10 Hz, as a vehicle sends them, and others between them."""

    def __init__(self, rate=1.0):
        self.continuity, self.rate = Continuity(), rate
        self.now_s, self.boot_s = 0.0, 500.0

    def goes_on(self, count=1, step_s=0.1):
        believed = []
        for _ in range(count):
            self.now_s += step_s / self.rate
            self.boot_s += step_s
            believed.append(self.says(self.boot_s, HERE))
        return believed

    def says(self, boot_s, position):
        return self.continuity.believes(ReportedPosition(boot_s, position), self.now_s, self.rate)


def test_a_message_of_another_boot_or_place_is_not_believed_nor_a_burst_of_them():
    told = Told()
    assert all(told.goes_on(20))
    for boot_s, position in ((3.0, HERE), (told.boot_s + 99.0, HERE), (told.boot_s, AWAY)):
        assert not any(told.says(boot_s, position) for _ in range(50))
        assert all(told.goes_on(20))


def test_a_vehicle_that_restarted_is_believed_once_the_old_one_is_not_heard_any_more():
    told = Told()
    told.goes_on(20)
    told.boot_s = 2.0
    believed = told.goes_on(20)
    assert believed == sorted(believed)
    assert believed.count(False) == max(MESSAGES, round(QUIET_S * 10)) - 1
    told.boot_s -= 0.5  # messages may overtake each other
    assert all(told.goes_on(5))


def test_a_link_that_was_lost_and_an_estimate_that_jumped_for_good_are_believed_soon():
    told = Told()
    told.goes_on(20)
    told.now_s, told.boot_s = told.now_s + 30.0, told.boot_s + 30.0
    assert told.goes_on(MESSAGES) == [False] * (MESSAGES - 1) + [True]
    places = [told.says(told.boot_s, AWAY)]
    for _ in range(9):
        told.now_s, told.boot_s = told.now_s + 0.1, told.boot_s + 0.1
        places.append(told.says(told.boot_s, AWAY))
    assert places[:MESSAGES] == [False] * MESSAGES
    assert places[-1]


def test_a_fast_simulation_that_stood_still_goes_on():
    told = Told(rate=20.0)
    assert all(told.goes_on(20) + told.goes_on(5, step_s=30.0))
