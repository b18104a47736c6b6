"""The table of states, and what is flown in each: exploring, seeking, hovering, coming home."""
