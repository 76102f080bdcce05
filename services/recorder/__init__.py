"""The recorder: every key of the table into one MCAP file an assembly, byte for byte as it travelled."""
