"""Tracking of plans with time-varying LQR, and terminal regulation at the goal."""
