"""The measurements of `crosspih bench`. Only commands.py imports the commands, so that a worker or a peer that needs
one module of these starts without the others.
"""
