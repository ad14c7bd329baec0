"""Scores of anybody's planner or policy on the fixed instances of a problem, by the same rules for all."""
