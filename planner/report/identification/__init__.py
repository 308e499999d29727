"""The identification of joints: in words, on a terminal, and on a page."""
