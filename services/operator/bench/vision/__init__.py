"""`crosspih bench vision`: where vision says the hole is."""
