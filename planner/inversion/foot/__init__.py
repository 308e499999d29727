"""Requests for a whole leg, planned in the foot's space, and what none can go below."""
