"""Contributions to a fit's sigmas, and what it cannot know."""
