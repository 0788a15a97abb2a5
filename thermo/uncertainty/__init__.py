"""What a fit's sigmas must allow for, and what it cannot know."""
