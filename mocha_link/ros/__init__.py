"""ROS messages as bytes, objects and JSON, without ROS."""
