"""`crosspih bench compare`: strategies side by side on the same seeds."""
