"""`crosspih results`: every table and figure of docs/results.md, from one declared list of commands."""
