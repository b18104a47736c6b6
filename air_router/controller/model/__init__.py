"""What the controller decides on and in: events, actions, states, requests, context."""
