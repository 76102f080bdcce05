"""What `crosspih bench` measures. The commands are put together in commands.py, so that a worker or a peer which needs
one module of these starts without the others."""
