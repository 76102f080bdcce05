"""`crosspih bench kills`: each service ended in each phase of an assembly, and how the cell reacts."""
