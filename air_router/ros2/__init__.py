"""A flight on ROS 2, without a ROS installation: its topics, services and actions."""
