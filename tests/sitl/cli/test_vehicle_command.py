"""`sitl vehicle` as a process, and its sockets."""

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from sitl.cli.cli import main
from sitl.mavlink.codec import frames
from sitl.process.vehicle import px4_ports
from sitl.team.truth import TruthReceiver

MISSION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"
LIMIT_S = 60


def test_it_prints_when_it_is_ready_sends_and_ends_on_a_signal():
    truth = TruthReceiver("udp://127.0.0.1:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.settimeout(LIMIT_S)
        port = client.getsockname()[1]
        command = [
            *(sys.executable, "-m", "sitl", "vehicle"),
            *(str(MISSION), "--speed", "10", "--instance", "3", "--no-gcs"),
            *("--api-to", f"127.0.0.1:{port}", "--truth-to", truth.url.removeprefix("udp://")),
        ]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen(command, **pipes) as process:
            ready = json.loads(process.stdout.readline())
            datagram, vehicle = client.recvfrom(65535)
            state = truth.receive(LIMIT_S)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.connect(("127.0.0.2", vehicle[1]))  # as other machines reach another one
                stranger.settimeout(LIMIT_S)
                stranger.send(b"?")
                with pytest.raises(ConnectionRefusedError):
                    stranger.recv(1)
            process.send_signal(signal.SIGTERM)
            assert process.wait(LIMIT_S) == 0
            ended = json.loads(process.stdout.read())
            assert process.stderr.read() == ""
    assert ended["simulated_s"] > 0
    assert ended["pace"]["requested"] == 10
    truth.close()
    assert ready["ready"] is True
    assert ready["mavlink"] == f"udpin://127.0.0.1:{port}"
    assert ready["truth"] == truth.url
    assert ready["gcs"] is None
    assert ready["system_id"] == 4
    assert [frame.system_id for frame in frames(datagram) if frame.name == "HEARTBEAT"] == [4]
    assert vehicle[0] == "127.0.0.1"
    home = ready["home"]
    assert state.latitude_deg == pytest.approx(home["latitude_deg"], abs=1e-5)  # single precision
    assert state.longitude_deg == pytest.approx(home["longitude_deg"], abs=1e-5)
    assert state.altitude_amsl_m == pytest.approx(home["altitude_amsl_m"], abs=0.01)


def test_a_taken_port_is_one_clear_error(capsys):
    ports = px4_ports(201)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(ports.onboard.bind)
        assert main(["vehicle", "--instance", "201"]) == 4
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert "port 14781" in printed.err
    assert "--instance" in printed.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--home", "here"], "LAT,LON,ALT"),
        (["--home", "95,0,0"], "not a place"),
        (["--speed", "0"], "between 0.1 and 100"),
        (["--speed", "fast"], "between 0.1 and 100"),
        (["--instance", "-1"], "instance"),
        (["--api-to", "14540"], "HOST:PORT"),
        (["--battery-minutes", "nan"], "above zero"),
        (["--no-gcs", "--gcs-to", "127.0.0.1:14550"], "contradict"),
        (["--px4-version", "1.14"], "'1.14' is none of 1.15, 1.16, 1.17, 1.18"),
        (["--param", "NO_SUCH=1"], "'NO_SUCH' is not a parameter of PX4's SITL"),
        (["--param", "COM_OBC_LOSS_T=5"], "PX4 1.18 has no parameter COM_OBC_LOSS_T"),
        (["--px4-version", "1.17", "--param", "MAN_OVERRIDE_SPD=1"], "PX4 1.17 has no parameter"),
    ],
)
def test_wrong_usage(capsys, arguments, message):
    assert main(["vehicle", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_mission_that_does_not_load_is_an_invalid_file(capsys, tmp_path):
    broken = tmp_path / "mission.yaml"
    broken.write_text("name: [", encoding="utf-8")
    assert main(["vehicle", str(broken)]) == 3
    assert str(broken) in capsys.readouterr().err


def test_the_ports_are_px4s():
    assert px4_ports(0).onboard.partner == ("127.0.0.1", 14540)
    assert px4_ports(2).onboard.bind == ("127.0.0.1", 14582)
    assert px4_ports(12).onboard.partner == ("127.0.0.1", 14549)
    assert px4_ports(1).ground.bind == ("127.0.0.1", 18571)
    assert px4_ports(1, "0.0.0.0").ground.bind == ("0.0.0.0", 18571)
    assert px4_ports(1).truth.partner == ("127.0.0.1", 19411)
