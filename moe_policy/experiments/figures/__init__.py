"""The figures of results/."""
