"""From a recording to an animation file: GIF, WebP or MP4 by its name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
from PIL import Image

from crosspih_common.errors import ConfigError
from crosspih_common.recording import read_recording
from services.operator.recordings.animating.frames import Film
from services.operator.recordings.animating.timing import frame_times
from services.operator.report.model import facts_of
from services.operator.scene3d.rasterising import Picture, can_draw

KINDS = (".webp", ".gif", ".mp4")
QUALITY = 84  # quality of a WebP


def animate(path: Path, out: Path, seconds: float, fps: float, truth: bool) -> int:
    """Write the animation; returns its number of frames. The plate stands where the cell itself found it, or with
    `truth` where it really is.

    Raises RecordingError, and ConfigError where it cannot be made.
    """
    if out.suffix.lower() not in KINDS:
        raise ConfigError(f"{out}: a moving picture is one of {', '.join(KINDS)}")
    if not can_draw():
        raise ConfigError(f"OpenCV {cv2.__version__} draws no pictures in space; install opencv-python-headless>=5")
    facts = facts_of(read_recording(path))
    hole, marked = facts.reference, facts.reference_name
    if truth:
        if facts.truth is None:
            raise ConfigError(f"{path}: holds no truth; leave --truth out")
        hole, marked = facts.truth.pose_base_hole.pose(), "the hole as it is: the simulator's truth"
    if facts.joints is None:
        raise ConfigError(f"{path}: holds no encoders, so there is no motion to show")
    film, times = Film(facts, hole, marked), frame_times(facts, seconds, fps)
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        _save(film.frames(times), out, fps)
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written ({error.strerror or error})") from None
    return len(times)


def _save(frames: Iterable[Picture], out: Path, fps: float) -> None:
    kind = out.suffix.lower()
    if kind == ".mp4":
        _save_mp4(frames, out, fps)
        return
    pictures = [Image.fromarray(frame) for frame in frames]
    if kind == ".gif":
        # one palette for all frames: otherwise colours flicker
        palette = pictures[len(pictures) // 2].quantize(128, method=Image.Quantize.MEDIANCUT)
        pictures = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
        pictures[0].save(
            out, save_all=True, append_images=pictures[1:], duration=round(1000 / fps), loop=0, optimize=True
        )
        return
    pictures[0].save(
        out, save_all=True, append_images=pictures[1:], duration=round(1000 / fps), loop=0, quality=QUALITY, method=4,
        minimize_size=True,
    )  # fmt: skip


def _save_mp4(frames: Iterable[Picture], out: Path, fps: float) -> None:
    writer: cv2.VideoWriter | None = None
    for frame in frames:
        if writer is None:
            high, wide = frame.shape[:2]
            writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), fps, (wide, high))
            if not writer.isOpened():
                raise OSError("OpenCV cannot write MP4 here")
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    if writer is not None:
        writer.release()
