"""Recordings: read as paths, replayed, and retimed."""
