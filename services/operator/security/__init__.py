"""`crosspih security`: the certificates of the stack."""
