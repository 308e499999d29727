"""From servos on a bus to models of their joints: measure, identify, compare, recommend."""
