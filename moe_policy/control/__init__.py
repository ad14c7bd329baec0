"""Tracking of a plan with time-varying LQR."""
