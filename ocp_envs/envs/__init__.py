"""Simulation, and the Gymnasium environments on it."""
