"""What was identified of a joint: in words, on a terminal, and on a page."""
