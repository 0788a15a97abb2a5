"""Simulated rig runs."""
