"""Sections 4.2 and 4.3 of the paper, and beyond: the requests for a desired path."""
