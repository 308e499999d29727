"""Requests that make a lagging, saturating joint follow the path you want."""

from __future__ import annotations
