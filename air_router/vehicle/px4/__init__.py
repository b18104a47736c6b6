"""A PX4: its link and messages, what is believed of them, orders, the plan on board."""
