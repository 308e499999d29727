"""Foot paths of gaits: half ellipses, the reference walk, strides, the shortest cycle."""
