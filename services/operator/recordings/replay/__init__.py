"""`crosspih replay`: repeats the requests of a recording to the services and compares the answers."""
