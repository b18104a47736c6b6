"""What the models of the channel decide: contacts, turns, durations."""

import itertools
import math
import statistics
from pathlib import Path

import numpy as np
import pytest

from sitl.experiment.engine.channel import (
    Link,
    LinkedChannel,
    Load,
    PaperChannel,
    PathLossChannel,
    Stage,
)
from sitl.experiment.settings import PaperModel, PathLossModel
from sitl.world.towns.town_file import load_town

TOWN = load_town(Path(__file__).parents[4] / "missions" / "urban" / "town.yaml")
NAMES = ("base", "uav01", "ugv01", "ugv02")
HEADER, DATA, END = (
    Load(Stage.HEADER, 0, 11, 1),
    Load(Stage.DATA, 1, 200, 1),
    Load(Stage.END, 0, 9, 1),
)


def places(*rows):
    return np.array(rows, dtype=float)


def test_linked_robots_are_in_contact_with_one_of_them_for_good_and_wait_for_nothing():
    channel = LinkedChannel(1, 4)
    here = places(*[(1000 * n, 0, 0) for n in range(4)])
    assert channel.update(0.0, here) == [(0, 1, True), (1, 2, True), (1, 3, True)]
    assert channel.update(1.0, here) == []
    assert channel.duration_s(Link(0, 1), DATA, 0.0) == 0.0
    assert not channel.occupied([Link(0, 1)])


class TestPaper:
    def test_latencies_have_the_means_of_the_stages(self):
        channel = PaperChannel(PaperModel(), 10.0, 4, seed=1)
        for load, rate in ((HEADER, 2.67), (DATA, 7.63), (END, 0.51)):
            seen = [channel.duration_s(Link(0, 1), load, 0.0) for _ in range(4000)]
            assert statistics.mean(seen) == pytest.approx(1 / rate, rel=0.08)
            assert statistics.stdev(seen) == pytest.approx(1 / rate, rel=0.1)

    def test_a_frame_of_messages_takes_the_time_of_each_unless_read_otherwise(self):
        many = Load(Stage.DATA, 20, 3000, 0)
        by_message = PaperChannel(PaperModel(), 10.0, 4, seed=1)
        by_frame = PaperChannel(PaperModel(piece="frame"), 10.0, 4, seed=1)
        long = statistics.mean(by_message.duration_s(Link(0, 1), many, 0.0) for _ in range(300))
        short = statistics.mean(by_frame.duration_s(Link(0, 1), many, 0.0) for _ in range(300))
        assert long == pytest.approx(20 / 7.63, rel=0.1)
        assert short < long / 10

    def test_contact_is_nearer_than_the_radius_horizontally(self):
        channel = PaperChannel(PaperModel(), 10.0, 3, seed=1)
        far = places((0, 0, 0), (10.0, 0, 60), (30, 0, 0))
        near = places((0, 0, 0), (9.9, 0, 60), (19.8, 0, 0))
        assert channel.update(0.0, far) == []
        assert channel.update(1.0, near) == [(0, 1, True), (1, 2, True)]
        assert channel.update(2.0, near) == []
        assert channel.update(3.0, far) == [(0, 1, False), (1, 2, False)]

    def test_what_was_cut_waits_or_is_given_up_by_the_reading(self):
        cuts = {"hold": math.inf, "drop": 0.0, "timeout": 5.0}
        for cut, patience_s in cuts.items():
            assert PaperChannel(PaperModel(cut=cut), 10.0, 4, seed=1).patience_s == patience_s

    def test_one_transmission_at_a_time_in_the_order_that_is_read(self):
        links = [Link(2, 0), Link(0, 3), Link(0, 1)]
        fixed = PaperChannel(PaperModel(), 10.0, 4, seed=1)
        assert sorted(links, key=lambda link: fixed.turn(link, 0.0)) == sorted(links)
        arrival = PaperChannel(PaperModel(order="arrival"), 10.0, 4, seed=1)
        ready = dict(zip(links, (3.0, 1.0, 2.0), strict=True))
        turns = sorted(links, key=lambda link: arrival.turn(link, ready[link]))
        assert turns == [Link(0, 3), Link(0, 1), Link(2, 0)]
        chance = PaperChannel(PaperModel(order="random"), 10.0, 4, seed=1)
        orders = {tuple(sorted(links, key=lambda link: chance.turn(link, 0.0))) for _ in range(60)}
        assert orders == set(itertools.permutations(links))
        assert fixed.occupied([Link(1, 3)]) == {0, 1, 2, 3}
        assert not fixed.occupied([])


class TestPathLoss:
    @pytest.fixture
    def channel(self):
        return PathLossChannel(PathLossModel(shadowing_db=0.0), TOWN, NAMES, seed=1)

    def test_a_contact_ends_at_a_weaker_signal_than_it_begins(self, channel):
        def changes(now_s, apart_m):
            # Along the main street, between antennas near the ground.
            street = places((0, 999, 0.5), (0, 1999, 0.5), (-30, 3, 0.5), (apart_m - 30, 3, 0.5))
            assert channel._radio.building_db(street[2:3, :2], street[3:, :2]) == 0.0
            return channel.update(now_s, street)

        # -75 dBm at 32 m, -78 dBm at 41 m.
        assert changes(0.0, 36.0) == []
        assert changes(1.0, 30.0) == [(2, 3, True)]
        assert changes(2.0, 36.0) == []
        assert changes(3.0, 44.0) == [(2, 3, False)]
        assert changes(4.0, 36.0) == []

    def test_buildings_cut_contacts(self, channel):
        street = places((-30, 3, 0.5), (-30, 3, 60), (-20, 3, 0.5), (0, 3, 0.5))
        up = {(change.a, change.b) for change in channel.update(0.0, street)}
        assert (0, 2) in up
        assert (0, 1) in up
        ring = next(ring for ring in TOWN.buildings)
        west = min(p.east_m for p in ring)
        east = max(p.east_m for p in ring)
        north = sum(p.north_m for p in ring) / len(ring)
        blocked = places((0, 0, 0.5), (0, 0, 60), (west - 1, north, 0.5), (east + 1, north, 0.5))
        down = {(change.a, change.b) for change in channel.update(1.0, blocked) if not change.up}
        assert (0, 2) in down
        assert channel._radio.building_db(blocked[2:3, :2], blocked[3:, :2]) > 3.0

    def test_near_links_are_faster_and_far_ones_do_not_disturb_each_other(self, channel):
        apart = places((-170, 30, 0.5), (-165, 30, 0.5), (60, -100, 0.5), (66, -100, 0.5))
        channel.update(0.0, apart)
        a, b = Link(0, 1), Link(3, 2)
        assert channel.occupied([a]) == {0, 1}
        assert not channel.occupied([])
        together = apart.copy()
        together[2:, :2] = (-160, 30), (-158, 30)
        channel.update(1.0, together)
        assert channel.occupied([a]) == {0, 1, 2, 3}
        load = Load(Stage.DATA, 1, 100_000, 0)
        assert channel.duration_s(b, load, 1.0) < channel.duration_s(Link(0, 3), load, 1.0)

    def test_with_a_line_of_sight_a_vehicle_is_in_contact_far_away_and_parked_stays_so(self):
        far = places((0, 999, 0.5), (0, 0, 60), (0, 85, 0.5), (60, 60, 0.5))
        models = {air: PathLossModel(air=air) for air in ("log_distance", "umi_av", "uma_av")}
        by_model = {
            air: [PathLossChannel(model, TOWN, NAMES, seed=seed) for seed in range(20)]
            for air, model in models.items()
        }
        share = {
            air: np.mean([(1, 2, True) in channel.update(0.0, far) for channel in channels])
            for air, channels in by_model.items()
        }
        assert share["log_distance"] < 0.5
        assert share["umi_av"] == share["uma_av"] == 1.0
        changed = {
            air: sum(len(channel.update(now_s, far)) for now_s in range(1, 60) for channel in own)
            for air, own in by_model.items()
        }
        assert changed["log_distance"] > 0
        assert changed["umi_av"] == changed["uma_av"] == 0

    def test_the_measured_link_is_shorter_than_one_in_the_open_and_fades_by_place(self):
        far = places((0, 999, 0.5), (0, 0, 60), (0, 300, 0.5), (9, 999, 0.5))
        up = {
            air: [
                {
                    (1, 2, True) in PathLossChannel(model, TOWN, NAMES, seed=seed).update(0.0, far)
                    for _ in range(2)
                }
                for seed in range(30)
            ]
            for air, model in (
                (air, PathLossModel(air=air, trigger_dbm=-80.0)) for air in ("umi_av", "aerpaw")
            )
        }
        assert all(len(same) == 1 for own in up.values() for same in own)
        met = {air: sum(True in same for same in own) for air, own in up.items()}
        assert 3 < met["aerpaw"] < 20 < met["umi_av"]

    def test_the_rate_is_that_of_802_11n_at_the_power(self):
        model = PathLossModel(rates="802.11n", shadowing_db=0.0)
        channel = PathLossChannel(model, TOWN, NAMES, seed=1)
        load = Load(Stage.DATA, 1, 1_000_000, 0)
        rates = {}
        for power_dbm in (-90.0, -82.0, -79.1, -70.0, -64.1, -64.0, -20.0):
            channel._rssi_dbm[0, 1] = power_dbm
            rates[power_dbm] = 8 / channel.duration_s(Link(0, 1), load, 0.0)  # Mbit/s
        assert list(rates.values()) == pytest.approx([3.25, 3.25, 3.25, 19.5, 29.25, 32.5, 32.5])
