"""Link of a running test to the people who ask and watch."""
