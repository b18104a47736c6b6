"""The simulated autopilot's MAVLink: links, streams, microservices."""
