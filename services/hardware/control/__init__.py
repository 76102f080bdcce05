"""The control layer: motions over any joint and wrench device, under caps. Imports no engine and no driver."""
