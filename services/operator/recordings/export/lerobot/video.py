"""Pictures as a video file."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.errors import ConfigError

if TYPE_CHECKING:
    from services.operator.recordings.export.lerobot.episodes import Pixels

CODECS = ("libx264", "libsvtav1", "mpeg4")  # the first one that this build of FFmpeg offers
OPTIONS = {"libx264": {"crf": "20", "preset": "ultrafast"}, "libsvtav1": {"crf": "30", "preset": "8"}}
KEY_EVERY = 2  # frames: a dataset is read at random places


def write_video(path: Path, pictures: list[Pixels], numbers: NDArray[np.int64], fps: int) -> str:
    """Write the picture of each step, black where its index is -1; returns the codec's name. Raises ConfigError without
    av.
    """
    try:
        import av
    except ImportError:
        raise ConfigError("video needs PyAV: pip install 'crosspih[lerobot]'") from None
    codec = next(name for name in CODECS if name in av.codecs_available)
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = pictures[0].shape[:2]
    black = np.zeros((height, width, 3), np.uint8)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=fps, options=OPTIONS.get(codec, {}))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.gop_size, stream.time_base = KEY_EVERY, Fraction(1, fps)
        for step, number in enumerate(numbers.tolist()):
            frame = av.VideoFrame.from_ndarray(pictures[number] if number >= 0 else black, format="rgb24")
            frame.pts, frame.time_base = step, Fraction(1, fps)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return {"libx264": "h264", "libsvtav1": "av1"}.get(codec, codec)
