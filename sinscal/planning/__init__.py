"""Covariance analysis of a rig programme."""
