"""Requests in the formats of robots: a module for each."""
