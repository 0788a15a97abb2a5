"""Reproduction of the source article's tables and experiments."""
