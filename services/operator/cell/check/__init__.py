"""`crosspih cell check`: what is wrong with a cell, and how to mend it. Judging is pure; `measuring.py` measures."""
