"""`crosspih bench kills`: each service ended in each phase of an assembly, and what the cell makes of it."""
