"""The room that is kept on the disk beside a storage."""

import pytest

from mocha_link.store.reserve import RESERVE_BYTES, Reserve


@pytest.fixture
def reserve(tmp_path):
    return Reserve(tmp_path / "titan.db")


@pytest.fixture
def place(tmp_path):
    return tmp_path / "titan.db-reserve"


def test_it_takes_its_room_from_the_disk_and_gives_it_back(reserve, place):
    assert reserve.hold()
    assert place.stat().st_blocks * 512 >= RESERVE_BYTES
    assert place.stat().st_mode & 0o077 == 0
    assert reserve.hold()  # it is held already
    assert reserve.release()
    assert not place.exists()
    assert not reserve.release()


def test_a_reserve_of_an_earlier_process_is_taken_over(reserve, tmp_path):
    assert Reserve(tmp_path / "titan.db").hold()
    assert reserve.hold()
    assert reserve.release()


@pytest.mark.parametrize("content", [b"", b"data of a user", bytes(RESERVE_BYTES)])
def test_another_file_of_its_name_is_left_alone(reserve, place, content):
    place.write_bytes(content)
    assert not reserve.hold()
    assert not reserve.release()
    assert place.read_bytes() == content


def test_no_link_is_followed(reserve, place, tmp_path):
    place.symlink_to(tmp_path / "elsewhere")
    assert not reserve.hold()
    assert not (tmp_path / "elsewhere").exists()


def test_where_no_file_can_be_made_there_is_no_reserve(tmp_path):
    reserve = Reserve(tmp_path / "nowhere" / "titan.db")
    assert not reserve.hold()
    assert not reserve.release()
