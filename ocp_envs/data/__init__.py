"""Databases of optimal trajectories and their generation."""
