"""Planners: p → trajectory."""
