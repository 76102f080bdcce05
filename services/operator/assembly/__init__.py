"""One assembly on a running cell: asked for, heard, recorded, shown; and the peg taken out again."""
