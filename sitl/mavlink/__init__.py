"""The simulated autopilot's MAVLink: links, streams, microservices."""

from mocha_link.errors import needs_extra

with needs_extra("the simulator", "sim", "air-router"):
    import pymavlink  # noqa: F401 - said here once, for all that speaks MAVLink
