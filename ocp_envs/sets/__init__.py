"""Sets of problem instances: random, near a discontinuity, outside the box, near the goal; reference costs."""
