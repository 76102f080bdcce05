"""What goes wrong on purpose: killed, busy, cut off, sent nonsense, pressed too hard, run for hours."""
