from mocha_link.store.wire import Header
from sitl.experiment.robots.node import fleet_of


def test_500_robots_share_the_first_byte_of_headers_and_differ_in_the_second():
    team = fleet_of(2, 500, base=False, original=False).team
    assert len(team.robots) == 502
    headers = {}
    for name, robot in team.robots.items():
        assert len(robot.peers) == 501
        for topic in team.topics_of(name):
            header = Header.at(robot.robot_id, topic.topic_id, 0)
            headers[header.pack()] = name, topic.name
            assert team.by_ids(header.robot_id, header.topic_id) == (robot, topic)
    assert len(headers) == 2 * 3 + 500 * 6
    assert {len(raw) for raw in headers} == {6}
    assert team.pushed(team.robot("ugv07"), "ugv08") == {team.robot("ugv07").robot_id}


def test_up_to_256_robots_are_a_team_as_a_file_has_it():
    team = fleet_of(1, 255, base=False, original=False).team
    assert [robot.robot_id for robot in team.robots.values()] == list(range(256))
    assert {topic.topic_id for topics in team.kinds.values() for topic in topics} == set(range(6))
