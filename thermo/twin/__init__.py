"""Physics behind emulated instruments."""
