"""Discrepancy."""
