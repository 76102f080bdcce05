"""`crosspih bench hosts`: the stack on three hosts, which are network namespaces of this machine."""
