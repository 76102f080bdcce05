"""`crosspih replay`: what services answered in a recording, asked of them again and compared."""
