"""Run-to-run stability."""
