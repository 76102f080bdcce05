"""The recorder: writes every key of the table into one MCAP file per assembly, byte for byte as it was sent."""
