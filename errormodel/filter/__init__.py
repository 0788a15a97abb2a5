"""Kalman filters: steps, gains, recursive least squares."""
