"""Digitisers."""
