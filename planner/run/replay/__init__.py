"""Recordings replayed: requests that make the joints follow what was recorded."""
