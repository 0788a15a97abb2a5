"""The thin shell: command line and reports."""
