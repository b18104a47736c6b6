"""What stands in for clocks, radios and libraries while the real flight program is rehearsed."""
