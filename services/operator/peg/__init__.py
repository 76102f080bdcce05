"""`crosspih peg check`: how a drawing is read, and whether it can be a peg and a hole."""
