"""Nonlinear programs: transcription, compiled functions, solvers and the check of their solutions."""
