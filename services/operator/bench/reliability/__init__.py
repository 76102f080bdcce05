"""Faults on purpose: killed processes, a busy machine, cut links, nonsense messages, presses beyond the cap, hours of
running.
"""
