"""Closed-loop rollouts and their metrics."""
