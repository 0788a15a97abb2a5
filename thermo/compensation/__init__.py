"""Model files, and their application to recordings."""
