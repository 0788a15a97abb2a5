"""Access to the page: users, log-ins, and what is refused before any page."""
