"""`crosspih bench matrix`: every process ended in every way in each phase of an assembly, and the cost of each."""
