"""From requests to a robot: when each is due, and a player that keeps to it."""
