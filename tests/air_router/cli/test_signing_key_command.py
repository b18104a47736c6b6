"""`air-router signing-key`, without a vehicle; with one: tests/system/test_signing.py."""

import pytest

from air_router.cli.cli import main
from air_router.vehicle.px4.signing_key import SigningKey


@pytest.fixture
def key(tmp_path, capsys):
    path = tmp_path / "uav.key"
    assert main(["signing-key", str(path)]) == 0
    assert str(path) in capsys.readouterr().err
    return path


def test_a_key_is_made_once_and_not_shown(key, capsys):
    secret = SigningKey.read(key).secret
    assert main(["signing-key", str(key)]) == 3
    printed = capsys.readouterr()
    assert "is kept" in printed.err
    assert secret.hex() not in printed.out + printed.err
    assert SigningKey.read(key).secret == secret


@pytest.mark.parametrize("arguments", [["--old", "old.key"], ["--remove"]])
def test_what_is_about_a_vehicle_needs_one(tmp_path, capsys, arguments):
    assert main(["signing-key", str(tmp_path / "uav.key"), *arguments]) == 2
    assert "add --connect URL" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    "url", ["udpin://0.0.0.0:14540", "udpout://10.0.0.5:14550", "tcpout://drone.local:5760"]
)
def test_a_key_does_not_leave_for_a_network_unasked(key, capsys, url):
    assert main(["signing-key", str(key), "--connect", url]) == 5
    assert "in the clear; connect PX4 by USB" in capsys.readouterr().err


def test_a_vehicle_is_not_given_what_is_no_key(tmp_path, capsys):
    path = tmp_path / "uav.key"
    path.write_text("no key")
    path.chmod(0o600)
    url = f"serial://{tmp_path}/tty:57600"
    assert main(["signing-key", str(path), "--connect", url]) == 3
    assert "this is no signing key" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--remove", "--old", "KEY"]])
def test_a_key_is_removed_with_itself(key, capsys, arguments):
    arguments = [str(key) if argument == "KEY" else argument for argument in arguments]
    assert main(["signing-key", str(key), "--connect", "serial:///dev/none:57600", *arguments]) == 2
    assert "needs no --old" in capsys.readouterr().err


def test_a_serial_line_that_is_not_there_is_one_clear_error(key, tmp_path, capsys):
    url = f"serial://{tmp_path}/tty:57600"
    arguments = ["--old", str(key), "--connect", url]
    assert main(["signing-key", str(key), *arguments]) == 4
    assert "is not there" in capsys.readouterr().err
