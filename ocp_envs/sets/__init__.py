"""Sets of problem instances: random, near a discontinuity, outside the parameter box; reference costs."""
