"""Files: tables, TOML, atomic writing, memory."""
