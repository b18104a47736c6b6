"""ROS messages as bytes, objects and JSON, without ROS."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "ros": ("RosCodec", "RosError"),
        "ros_store": ("RosTypes", "element"),
        "typed": ("Typed", "TypedError", "Types"),
    },
)
