"""UVC cameras and video files by OpenCV, two devices or one picture with both sides: docs/hardware/video.md."""
