"""What another user has put where something is to be written: it is not written through."""

import stat

import pytest

from mocha_link.bridges.progress import Progress
from mocha_link.path_safety import check_links, made_folder, new_file
from mocha_link.store.storage_file import connect
from tests.mocha_link.foreign import foreign_link


@pytest.fixture
def victim(tmp_path):
    path = tmp_path / "victim"
    path.write_text("precious")
    return path


def test_our_own_links_are_followed_and_what_is_not_there_is_no_link(tmp_path, victim):
    (tmp_path / "folder").symlink_to(tmp_path)
    (tmp_path / "link").symlink_to("victim")
    check_links(tmp_path / "folder" / "link")
    check_links(tmp_path / "none" / "nowhere")


@pytest.mark.parametrize("through", ["file", "folder", "links"])
def test_a_link_of_another_user_is_refused_wherever_on_the_way(
    tmp_path, victim, monkeypatch, through
):
    path = tmp_path / "link"
    if through == "folder":
        foreign_link(path, tmp_path, monkeypatch)
        path /= "victim"
    elif through == "links":
        foreign_link(tmp_path / "theirs", victim, monkeypatch)
        path.symlink_to("theirs")
    else:
        foreign_link(path, victim, monkeypatch)
    with pytest.raises(PermissionError, match="is a link of another user"):
        check_links(path)


def test_links_in_a_circle_end(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OSError, match="Too many levels"):
        check_links(tmp_path / "a")


@pytest.mark.parametrize("kind", ["symlink", "hardlink"])
def test_a_new_file_takes_the_place_of_a_link_not_of_what_it_leads_to(tmp_path, victim, kind):
    path = tmp_path / "log"
    path.symlink_to(victim) if kind == "symlink" else path.hardlink_to(victim)
    with new_file(path) as file:
        file.write(b"new")
    assert (path.read_text(), victim.read_text()) == ("new", "precious")
    assert not path.is_symlink()
    assert {each.name for each in tmp_path.iterdir()} == {"victim", "log"}


def test_a_file_that_cannot_take_its_place_leaves_nothing(tmp_path):
    (tmp_path / "log" / "inner").mkdir(parents=True)
    with pytest.raises(OSError, match="log") as caught:
        new_file(tmp_path / "log")
    assert caught.value.filename == str(tmp_path / "log")
    assert [each.name for each in tmp_path.iterdir()] == ["log"]


def test_a_folder_for_programs_that_follow_links_is_ours_alone(tmp_path):
    folder = made_folder(tmp_path / "px4", private=True)
    folder.chmod(0o777)
    with pytest.raises(PermissionError, match="other users may write"):
        made_folder(folder, private=True)
    made_folder(folder)


def test_a_folder_that_is_a_link_of_another_user_is_none(tmp_path, monkeypatch):
    foreign_link(tmp_path / "logs", tmp_path, monkeypatch)
    with pytest.raises(PermissionError, match="is a link of another user"):
        made_folder(tmp_path / "logs")


def test_databases_are_not_opened_through_a_link_of_another_user(tmp_path, victim, monkeypatch):
    before = victim.read_bytes()
    foreign_link(tmp_path / "messages.db", victim, monkeypatch)
    with pytest.raises(PermissionError, match="is a link of another user"):
        connect(tmp_path / "messages.db")
    Progress(tmp_path / "messages.db").close()  # in memory then
    assert victim.read_bytes() == before
    assert stat.S_ISLNK((tmp_path / "messages.db").lstat().st_mode)
