"""One assembly on a running cell: started, observed, recorded and shown; and the withdrawal of the peg."""
