"""Fit of recorded runs."""
