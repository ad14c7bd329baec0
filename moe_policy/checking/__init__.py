"""Plans that are checked by simulation with the model, repaired where they fail, and withheld where nothing helps."""
