"""`crosspih locate`: where the hole is, from photos, with no stack running."""
