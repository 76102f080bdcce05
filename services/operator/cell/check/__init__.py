"""`crosspih cell check`: what is wrong with a cell, and how to mend it. The judgements are pure; `measuring.py`
measures.
"""
