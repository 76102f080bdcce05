"""`crosspih train`, and the page that evaluates the trained network."""
