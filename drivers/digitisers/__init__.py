"""Digitisers, and thermistors read by them."""
