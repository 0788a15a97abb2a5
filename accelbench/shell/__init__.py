"""Parts that all commands share: console, outputs, pages, plots."""
