"""What all commands share: console, outputs, pages, plots."""
