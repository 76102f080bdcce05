"""GenICam cameras over GigE Vision, two of them as a stereo pair, by libaravis: docs/hardware/genicam.md."""
