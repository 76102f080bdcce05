"""The HTML page: content to words and numbers, numbers to the template."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import jinja2
import numpy as np
from matplotlib.image import imsave
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.messages import Image, PoseData
from crosspih_common.recording import read_recording
from services.operator.report.content import Content, TouchEntry, collect
from services.operator.report.figure import PHASE_COLOURS, figure_svg
from services.operator.scoring.score import PoseError, pose_error, seen_in_words

PICTURE_QUALITY = 88
PAPER_DURATION_S = 27  # the paper's one experiment, for comparison


@dataclass(frozen=True, slots=True)
class Card:
    """One figure of the summary."""

    name: str
    value: str
    unit: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One line of the pose table: cells of the columns, in their order."""

    name: str
    cells: tuple[str, ...]


def number(value: float | None, digits: int = 2) -> str:
    """For people: a true minus sign, a dash where there is no value, no minus zero."""
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def picture(image: Image | None) -> str | None:
    """A picture as a `data:` address."""
    if image is None:
        return None
    buffer = io.BytesIO()
    pixels = np.repeat(image.pixels[:, :, None], 3, axis=2) if image.pixels.ndim == 2 else image.pixels
    imsave(buffer, np.ascontiguousarray(pixels), format="jpeg", pil_kwargs={"quality": PICTURE_QUALITY})
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def cards(content: Content) -> list[Card]:
    """The summary's figures; empty without a result."""
    figures = content.figures
    if figures is None:
        return []
    pushes = "1 push in all" if figures.pushes == 1 else f"{figures.pushes} pushes in all"
    return [
        Card(
            "duration",
            number(figures.duration_s, 1),
            "s",
            f"{number(figures.motion_s, 1)} s moving, {number(figures.thinking_s, 1)} s thinking; "
            f"the paper's took {PAPER_DURATION_S} s",
        ),
        Card("peak force", number(figures.peak_force_n, 1), "N", f"peak moment {number(figures.peak_moment_nm)} Nm"),
        Card("touches", str(figures.touches), "", "times it felt its way"),
        Card("corrections", str(figures.corrections), "", pushes),
        Card(
            "vision error",
            number(figures.vision_error_mm),
            "mm",
            f"sideways; {number(figures.vision_error_deg)}° turned, {number(figures.vision_depth_mm)} mm in depth; "
            f"vision {seen_in_words(figures)}",
        ),
        Card(
            "final error",
            number(figures.final_error_mm, 3),
            "mm",
            f"sideways; {number(figures.final_error_deg)}° turned, {number(figures.final_depth_mm)} mm in depth",
        ),
        Card("insertion depth", number(figures.insertion_depth_mm, 1), "mm", "of the peg's body past the rim"),
    ]


def _matrix(pose: Pose) -> str:
    rows = ["  ".join(f"{value:+.4f}".replace("-", "−").replace("+", " ") for value in row) for row in pose.matrix()]
    return "\n".join(rows)


def pose_table(content: Content) -> tuple[tuple[str, ...], list[PoseRow], list[tuple[str, str]]]:
    """(column heads, rows, matrices): where the hole was seen, found and is, and how far the first two are off."""
    result, truth = content.result, content.truth
    poses: list[tuple[str, PoseData | None]] = [
        ("as the cameras saw it", result.vision_pose_base_hole if result else None),
        ("as found in the end (T2)", result.pose_base_hole if result else None),
        ("as it is (truth)", truth.pose_base_hole if truth else None),
    ]
    columns = [(name, data.pose()) for name, data in poses if data is not None]
    if not columns:
        return (), [], []
    rows = [
        PoseRow(f"{axis} / mm", tuple(number(pose.translation_m[index] * 1e3) for _, pose in columns))
        for index, axis in enumerate("xyz")
    ]
    if truth is not None:
        true_hole = truth.pose_base_hole.pose()
        order = content.workcell.peg.shape().outline.symmetry_order
        offs = [_difference(pose, true_hole, order) for _, pose in columns]
        names = (
            "off along the hole's x / mm",
            "off along the hole's y / mm",
            "off in depth (hole's z) / mm",
            "turned about the hole's x / °",
            "turned about the hole's y / °",
            "turned about the hole's z / °",
        )
        rows += [PoseRow(name, tuple(number(off[index], 3) for off in offs)) for index, name in enumerate(names)]
    return tuple(name for name, _ in columns), rows, [(name, _matrix(pose)) for name, pose in columns]


def _difference(pose: Pose, true_hole: Pose, symmetry_order: int) -> list[float]:
    """x, y, z in mm and the rotation vector in degrees, in the true hole's frame, up to the section's own turns."""
    error = true_hole.inverse() @ pose
    turns = np.arange(symmetry_order) * (2.0 * np.pi / symmetry_order) if symmetry_order else np.zeros(1)
    if symmetry_order == 0:
        turned_by = np.arctan2(error.rotation[1, 0] - error.rotation[0, 1], error.rotation[0, 0] + error.rotation[1, 1])
        turns = np.array([-turned_by])
    candidates = Rotation.from_matrix(error.rotation) * Rotation.from_euler("z", turns[:, None])
    turned = candidates[int(np.argmin(candidates.magnitude()))].as_rotvec(degrees=True)
    return [*(error.translation_m * 1e3).tolist(), *turned.tolist()]


@dataclass(frozen=True, slots=True)
class TouchRow:
    """One touch in words and numbers."""

    number: int
    time_s: str
    wrench: tuple[str, ...]
    state: str
    confidence: str
    reason: str
    angles: str
    offset: str
    rank: str
    friction: str
    error: str
    use: str


def touch_row(index: int, entry: TouchEntry, true_hole: Pose | None, symmetry_order: int = 4) -> TouchRow:
    """A touch, the estimate made after it, and how far that estimate was from the truth."""
    state, estimate, use = entry.touch.state, entry.estimate, entry.use
    off: PoseError | None = None
    if estimate is not None and true_hole is not None:
        off = pose_error(estimate.pose_base_hole.pose(), true_hole, symmetry_order)
    return TouchRow(
        number=index,
        time_s=number(entry.time_s),
        wrench=(
            *(number(value, 1) for value in entry.touch.wrench[:3]),
            *(number(value, 2) for value in entry.touch.wrench[3:]),
        ),
        state="on a wall of the bore" if entry.touch.seated else state.case or "none of the 26",
        confidence="" if entry.touch.seated else f"{state.confidence * 100:.0f} %",
        reason="the peg is in: pressed sideways for the exact pose" if entry.touch.seated else state.reason,
        angles="–" if estimate is None else ", ".join(number(float(np.rad2deg(a))) for a in estimate.angles_rad),
        offset="–" if estimate is None else ", ".join(number(value * 1e3) for value in estimate.translation_m),
        rank="–" if estimate is None else f"{estimate.rank} of 6",
        friction="–" if estimate is None else f"{number(estimate.friction)} ± {number(estimate.friction_sd)}",
        error="–" if off is None else f"{number(off.lateral_mm)} mm, {number(off.rotation_deg)}°",
        use="–"
        if use is None
        else f"{use.hypothesis}, {number(use.residual_sigma, 1)} σ" + ("" if use.used else " (set aside)"),
    )


def verdict(content: Content) -> tuple[str, str, str]:
    """(css class, headline, sentence)."""
    result, figures = content.result, content.figures
    if result is None or figures is None:
        return "unknown", "No result in this recording", "The assembly had not ended when the file did."
    if figures.inserted:
        return "good", "Inserted", f"The peg sits {number(figures.insertion_depth_mm, 1)} mm deep in its hole."
    where = "The peg was backed off." if result.backed_off else "The peg was not backed off."
    name = figures.failure or "no reason given"
    return "bad", f"Not inserted: {name.replace('_', ' ')}", " ".join(filter(None, (result.failure_detail, where)))


def render(content: Content) -> str:
    """The page as text."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    recording, truth = content.recording, content.truth
    heads, pose_rows, matrices = pose_table(content)
    true_hole = truth.pose_base_hole.pose() if truth else None
    css, headline, sentence = verdict(content)
    used_phases = {span.message.phase: PHASE_COLOURS.get(span.message.phase, "#888888") for span in content.spans}
    return environment.get_template("page.html.j2").render(
        file=recording.path.name,
        cell=recording.cell,
        started=recording.metadata.get("recording", {}).get("started", ""),
        seed=truth.seed if truth else None,
        strategy=content.result.strategy.value if content.result else None,
        verdict=css,
        headline=headline,
        sentence=sentence,
        cards=cards(content),
        warnings=content.result.warnings if content.result else (),
        missing=content.missing,
        figure=figure_svg(content),
        phases=used_phases,
        touches=[
            touch_row(index, entry, true_hole, content.workcell.peg.shape().outline.symmetry_order)
            for index, entry in enumerate(content.touches, start=1)
        ],
        has_truth=truth is not None,
        left=picture(content.left),
        right=picture(content.right),
        spans=content.spans,
        pose_heads=heads,
        pose_rows=pose_rows,
        matrices=matrices,
        services=content.services,
        events=content.events,
        drops=recording.metadata.get("drops"),
        gaps=content.gaps,
        counts=sorted((key, len(samples)) for key, samples in recording.samples.items()),
        versions=recording.metadata.get("versions", {}),
        yaml=recording.metadata.get("cell", {}).get("yaml", ""),
    )


def make_report(mcap_path: str | Path, html_path: str | Path) -> None:
    """Write the page about a recording. Raises RecordingError when the file is no recording, OSError for the page."""
    page = render(collect(read_recording(mcap_path)))
    html_path = Path(html_path)
    html_path.parent.mkdir(parents=True, exist_ok=True)
    html_path.write_text(page, encoding="utf-8")


__all__ = ["make_report", "render"]
