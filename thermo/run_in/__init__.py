"""Run-in after assembly: relaxation, and when it has ended."""
