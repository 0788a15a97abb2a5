"""The commands, a folder each: options, text, figures, page."""
