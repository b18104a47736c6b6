"""One file per state of the mission: explore, search, communicate, go to, hold, return."""
