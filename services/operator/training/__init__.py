"""`crosspih train`, and the page that judges what was trained."""
