"""A pretended gossip node, for flights that are about something else."""


class Alone:
    """The gossip of a UAV that meets no peer."""

    def __init__(self):
        self.closed = False
        self.maps = 0

    def start(self, deliver):
        pass

    def held(self):
        return {}

    def links(self):
        return {}

    def publish_telemetry(self, telemetry):
        assert not self.closed

    def publish_map(self, time_s):
        self.maps += 1

    def exchange(self):
        pass

    def publish_ack(self, answer):
        pass

    def publish_sought(self, robot, time_s):
        pass

    def newest_stamps(self):
        return {}

    def close(self):
        self.closed = True
