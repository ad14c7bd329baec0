"""Reinforcement learning: training of the baselines, and their policies."""
