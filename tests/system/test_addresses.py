"""Nodes on machines of their own, whose addresses are IPv6, names, announced by mDNS, and change.

The machines are network namespaces. What is asserted of times is far above what they are.
"""

import subprocess
import sys
import time

import pytest

from tests.system.machines import ROOT, lacking, machines

pytestmark = pytest.mark.foreign_process

if reason := lacking():
    pytest.skip(reason, allow_module_level=True)

FOUND_S = 20.0
"""Without what is tested here a peer that has moved is found after 30 s, or never."""

TEAM = """
robots:
  a: {kind: rover, %s base_port: 24100, clients: [b]}
  b: {kind: rover, %s base_port: 24200, clients: [a]}
kinds:
  rover: {topics: [{name: /count, type: json/Count, priority: high}]}
"""
A4, B4, C4 = "10.99.0.1", "10.99.0.2", "10.99.0.3"
A6, B6, C6 = "fd99::1", "fd99::2", "fd99::3"


@pytest.fixture
def two(tmp_path):
    """Two machines, and how a robot of a team runs on one of them."""

    class Two:
        def __init__(self, a, b, stranger):
            self.a, self.b, self.stranger = a, b, stranger

        def start(self, a_address, b_address, *, keys=False):
            stated = [f'address: "{each}",' if each else "" for each in (a_address, b_address)]
            team = tmp_path / "team.yaml"
            team.write_text(TEAM % tuple(stated))
            folder = "-"
            if keys:
                command = [sys.executable, "-m", "mocha_link", "keys", str(team)]
                subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
                folder = str(tmp_path / "keys")
            return [
                machine.run("count_robot.py", str(team), name, folder)
                for machine, name in ((self.a, "a"), (self.b, "b"))
            ]

    with machines("a", "b", "c") as found:
        yield Two(*found)


def alone(two, tmp_path, a_address, b_address):
    """Two robots of which only a can dial the other one."""
    a, b = (tmp_path / f"{name}.yaml" for name in "ab")
    stated = [f"address: {each}," if each else "" for each in (a_address, b_address)]
    a.write_text(TEAM % tuple(stated))
    b.write_text(TEAM % ("address: 10.99.0.99,", stated[1]))
    return two.a.run("count_robot.py", str(a), "a", "-"), two.b.run(
        "count_robot.py", str(b), "b", "-"
    )


def exchange(a, b, after_s=0.0):
    """Both receive what the other one publishes after a time; how long that took at most."""
    return max(a.receives("b", after_s, FOUND_S), b.receives("a", after_s, FOUND_S)) - after_s


def move(machine, old, new, prefix=24):
    """A machine gets another address; when."""
    machine.remove(f"{old}/{prefix}")
    machine.add(f"{new}/{prefix}")
    return time.monotonic()


@pytest.mark.parametrize("keys", [False, True])
def test_ipv6(two, keys):
    two.a.add(f"{A6}/64")
    two.b.add(f"{B6}/64")
    exchange(*two.start(A6, f"[{B6}]", keys=keys))


def test_addresses_of_one_link_go_by_their_interface(two):
    exchange(*two.start(f"{two.a.link_local()}%eth0", f"{two.b.link_local()}%eth0"))


def test_one_robot_is_at_ipv4_the_other_at_ipv6(two):
    for machine, four, six in ((two.a, A4, A6), (two.b, B4, B6)):
        machine.add(f"{four}/24")
        machine.add(f"{six}/64")
    exchange(*two.start(A4, B6))


@pytest.mark.parametrize("prefix", [24, 64])
def test_a_name_gets_another_address_in_mid_contact(two, prefix):
    ours, theirs, new = (A4, B4, C4) if prefix == 24 else (A6, B6, C6)
    two.a.add(f"{ours}/{prefix}")
    two.b.add(f"{theirs}/{prefix}")
    for machine in (two.a, two.b):
        machine.knows(alpha=ours, beta=theirs)
    a, b = two.start("alpha", "beta")
    exchange(a, b)
    moved_s = move(two.b, theirs, new, prefix)
    two.a.knows(alpha=ours, beta=new)
    print(f"found after {exchange(a, b, moved_s):.2f} s")


def test_a_name_gets_another_address_and_the_robot_cannot_dial(two, tmp_path):
    """It is resolved again as soon as the connection does not answer."""
    two.a.add(f"{A4}/24")
    two.b.add(f"{B4}/24")
    two.a.knows(beta=B4)
    a, _ = alone(two, tmp_path, A4, "beta")
    a.receives("b")
    moved_s = move(two.b, B4, C4)
    two.a.knows(beta=C4)
    print(f"found after {a.receives('b', moved_s, FOUND_S) - moved_s:.2f} s")


@pytest.mark.parametrize("keys", [False, True])
def test_a_robot_is_not_any_more_where_the_team_file_has_it(two, keys):
    """Its own connection shows where it is."""
    two.a.add(f"{A4}/24")
    two.b.add(f"{B4}/24")
    a, b = two.start(A4, B4, keys=keys)
    exchange(a, b)
    print(f"found after {exchange(a, b, move(two.b, B4, C4)):.2f} s")


@pytest.mark.parametrize("keys", [False, True])
def test_robots_without_an_address_find_each_other(two, keys):
    pytest.importorskip("zeroconf")
    two.a.add(f"{A4}/24")
    two.b.add(f"{B4}/24")
    a, b = two.start(None, None, keys=keys)
    exchange(a, b)
    print(f"found after {exchange(a, b, move(two.b, B4, C4)):.2f} s")


def test_a_hostile_announcement_does_not_redirect_a_robot_with_keys(two, tmp_path):
    """A stranger on the link takes connections to b, announces b, and repeats b's public key."""
    pytest.importorskip("zeroconf")
    two.a.add(f"{A4}/24")
    two.b.add(f"{B4}/24")
    two.stranger.add(f"{C4}/24")
    a, b = two.start(None, None, keys=True)
    exchange(a, b)
    stranger = two.stranger.run("announcing_stranger.py", str(tmp_path / "team.yaml"), "b", "a", C4)
    assert stranger.line() == ["ready"]
    b.process.kill()
    assert stranger.line() == ["taken"]  # b is looked for there, too
    b = two.b.run("count_robot.py", str(tmp_path / "team.yaml"), "b", str(tmp_path / "keys"))
    exchange(a, b, time.monotonic())


@pytest.mark.parametrize("runs", [False, True])
def test_the_doctor_finds_a_second_robot_of_the_same_name(two, tmp_path, runs):
    """It runs on b's computer as a, which the team file has elsewhere."""
    two.a.add(f"{A4}/24")
    two.b.add(f"{B4}/24")
    team = tmp_path / "team.yaml"
    team.write_text(TEAM % (f"address: {A4},", f"address: {B4},"))
    if runs:
        assert two.a.run("count_robot.py", str(team), "a", "-").line() == ["ready"]
    out = two.b.answer("doctor", str(team), "--robot", "a", "--seconds", "1")
    assert f"BAD  '{A4}' in the team file is no address of this computer" in out
    assert ("two robots run as a" in out) is runs
    assert ("the others do not find a" in out) is not runs


def test_the_machines_add_no_interface_to_the_machine_they_run_on():
    """Browsers of other tests drop their connections when an interface comes or goes."""
    with machines("a", "b") as (a, _):
        link = a.name.partition("-")[0]
        command = ["ip", "-o", "link", "show"]
        shown = subprocess.run(command, capture_output=True, check=True, text=True).stdout
    assert "lo:" in shown
    assert link not in shown
