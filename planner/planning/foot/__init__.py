"""Requests for a whole leg, planned in the foot's space, and a lower bound on the foot's error."""
