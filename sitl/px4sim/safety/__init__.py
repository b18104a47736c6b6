"""What the autopilot does by itself: arming checks, failsafes, its fence."""
