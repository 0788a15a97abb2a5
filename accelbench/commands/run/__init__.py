"""`run`, `runs`, `export`, `emulate`, `make-safe`."""
