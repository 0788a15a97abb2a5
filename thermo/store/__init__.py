"""Store of tests: SQLite or PostgreSQL, and the spool before it."""
