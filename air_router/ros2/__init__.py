"""A flight on ROS 2, without a ROS installation: its topics, services and actions."""

__all__: list[str] = []  # its commands are found by their modules' names
