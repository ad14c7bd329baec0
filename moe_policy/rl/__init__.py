"""Reinforcement learning: the baselines."""
