"""The table of states, and what is flown in each: exploring, seeking, going to points, coming home."""
