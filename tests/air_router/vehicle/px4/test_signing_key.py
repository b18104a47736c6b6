"""The file of the signing key, and the time of the last signature beside it."""

import os

import pytest

from air_router.vehicle.px4.signing_key import SigningKey, SigningKeyError, TimestampFile

SECRET = bytes(range(1, 33))


def file_of(folder, data, mode=0o600):
    path = folder / "uav.key"
    path.write_bytes(data)
    path.chmod(mode)
    return path


def test_a_new_key_is_written_for_its_owner_only_and_read_back(tmp_path):
    path, key = tmp_path / "uav.key", SigningKey.generate()
    assert SigningKey.generate() != key
    before = os.umask(0)
    try:
        key.write(path)
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o600
    assert SigningKey.read(path) == key


@pytest.mark.parametrize(
    "data", [SECRET, SECRET.hex().encode(), SECRET.hex().upper().encode() + b"\r\n"]
)
def test_a_key_is_32_bytes_or_64_digits(tmp_path, data):
    assert SigningKey.read(file_of(tmp_path, data)).secret == SECRET


@pytest.mark.parametrize(
    "data", [b"", SECRET[:-1], SECRET + b"\n", SECRET.hex()[1:].encode(), b"g" * 64, b"a" * 5000]
)
def test_what_is_no_key_is_one_clear_error_that_does_not_show_it(tmp_path, data):
    with pytest.raises(SigningKeyError, match="this is no signing key") as caught:
        SigningKey.read(file_of(tmp_path, data))
    assert not data or data.decode("latin-1") not in str(caught.value)


@pytest.mark.parametrize("data", [bytes(32), b"0" * 64])
def test_zeros_are_no_key(tmp_path, data):
    with pytest.raises(SigningKeyError, match="turns signing off"):
        SigningKey.read(file_of(tmp_path, data))


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_key_that_others_can_read_is_refused(tmp_path, mode):
    with pytest.raises(SigningKeyError, match="chmod 600"):
        SigningKey.read(file_of(tmp_path, SECRET, mode))


def test_a_key_that_is_not_there_is_one_clear_error(tmp_path):
    with pytest.raises(SigningKeyError, match="cannot be read: No such file"):
        SigningKey.read(tmp_path / "uav.key")


def test_a_folder_and_a_pipe_are_no_files(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (tmp_path, pipe):
        with pytest.raises(SigningKeyError, match=r"no file|Is a directory"):
            SigningKey.read(path)


def test_a_file_that_is_there_is_kept(tmp_path):
    path = file_of(tmp_path, b"precious")
    link = tmp_path / "link.key"
    link.symlink_to(tmp_path / "elsewhere")
    for taken in (path, link):
        with pytest.raises(SigningKeyError, match="there is a file already"):
            SigningKey.generate().write(taken)
    assert path.read_bytes() == b"precious"
    assert not (tmp_path / "elsewhere").exists()


def test_a_key_that_cannot_be_written_is_one_clear_error(tmp_path):
    with pytest.raises(SigningKeyError, match="cannot be written"):
        SigningKey.generate().write(tmp_path / "nowhere" / "uav.key")


def test_times_are_kept_and_the_latest_of_two_programs_counts(tmp_path):
    times = TimestampFile(tmp_path / "uav.key")
    assert times.load() == 0
    times.store(12)
    TimestampFile(tmp_path / "uav.key").store(10)
    assert times.load() == 12


@pytest.mark.parametrize("data", [b"", b"soon", b"-5", b"9" * 15, b"9" * 16, b"\xff\x00"])
def test_a_damaged_time_is_logged_and_the_clock_counts(tmp_path, caplog, data):
    (tmp_path / "uav.key.timestamp").write_bytes(data)
    assert TimestampFile(tmp_path / "uav.key").load() == 0
    assert "is damaged" in caplog.text


def test_a_time_that_cannot_be_kept_is_logged_once(tmp_path, caplog):
    times = TimestampFile(tmp_path / "nowhere" / "uav.key")
    times.store(1)
    times.store(2)
    assert caplog.text.count("cannot be kept") == 1
