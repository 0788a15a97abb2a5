"""Links to instruments: Modbus and serial lines, with their failures."""
