"""What the runs show: tables, intervals, tests of the claims."""
