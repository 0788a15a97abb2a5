"""Other people's logs: the mapping file, the log as cells, the recorded run made of them."""
