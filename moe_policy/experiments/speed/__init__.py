"""How fast the environments, rollouts, the solver and the generation of data are, as ratios to alternatives."""
