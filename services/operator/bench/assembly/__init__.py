"""`crosspih bench assembly`: many seeds, and the distribution of their results."""
