"""Sequences, and the plans made of them."""
