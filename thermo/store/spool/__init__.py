"""The spool: a running test goes round a store that does not answer, and nothing is lost."""
