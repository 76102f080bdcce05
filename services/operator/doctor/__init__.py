"""`crosspih doctor`: could an assembly start, and if not, what mends it?"""
