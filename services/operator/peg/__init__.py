"""`crosspih peg check`: what a drawing is read as, and whether it can be a peg and a hole."""
