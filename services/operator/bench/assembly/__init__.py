"""`crosspih bench assembly`: many seeds, and the distribution of what came out."""
