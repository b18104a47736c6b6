"""The first promise of the README: one command, and a whole communication-aware flight."""

import json

import pytest

SPEED = 25
DURATION_S = 400


@pytest.fixture
def flown(command, short_mission, tmp_path):
    flight = command(
        "air_router.cli",
        "sim",
        short_mission,
        f"--speed={SPEED}",
        f"--duration={DURATION_S}",
        "--json",
        "--log-dir",
        tmp_path / "logs",
    )
    code, out = flight.finish(100)
    assert code == 0, flight.said
    lines = [
        json.loads(line)
        for path in (tmp_path / "logs").glob("flight-*.jsonl")
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    return json.loads(out), lines, flight.said


def test_the_uav_explores_finds_all_robots_carries_their_data_and_comes_home(flown, tmp_path):
    report, lines, said = flown
    assert report["outcome"] == "done"
    assert {"INIT", "SEARCH", "COMM", "EXPL", "HOME", "LAND"} <= set(report["states_visited"])
    assert DURATION_S < report["duration_s"] < DURATION_S + 300
    assert report["closest_approach_m"] >= report["clearance_m"] == 5.0

    robots, world = report["robots"], report["world"]["robots"]
    for name in ("callisto", "europa", "io"):
        assert robots[name]["found"] >= 1
        assert robots[name]["syncs_in"] > 0
        assert robots[name]["syncs_out"] > 0
        # What the robot holds in truth, against what was painted before it last came for it.
        last_contact_s = max(
            line["t"]
            for line in lines
            if line["type"] == "SyncEnded" and (line["peer"], line["direction"]) == (name, "OUT")
        )
        painted = max(
            line["known_cells"]
            for line in lines
            if line["type"] == "Map" and line["t"] <= last_contact_s
        )
        assert world[name]["map"]["known_cells"] >= 0.8 * painted
        assert robots[name]["map_share"] >= 0.8

    carried = {tuple(pair) for pair in report["world"]["carried"]}
    assert any(
        (a, b) in carried and (b, a) in carried and world[a]["contacts"][b]["count"] == 0
        for a in world
        for b in world
    )
    assert report["interactions"]["completed"] > 0.9 * report["interactions"]["started"]

    assert "SEARCH -> COMM" in said
    assert "closest approach" in said
    assert (tmp_path / "logs" / "track.png").read_bytes().startswith(b"\x89PNG")
    kinds = {line["kind"] for line in lines}
    assert kinds == {"flight", "event", "action"}
    assert lines[-1]["type"] == "Report"
