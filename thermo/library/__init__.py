"""Terms of accelerometers over temperature, and the effects that they make up."""
