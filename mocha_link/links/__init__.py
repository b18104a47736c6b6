"""What happens on the links, and their state: what another planner embeds."""
