"""Draw the figures of docs/how-it-works.md into docs/figures, for a light and a dark page. From the project's root:

    .venv/bin/python -m docs.make_figures

The contact, the touches and the rim are computed by the services' own code, not sketched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyArrowPatch, FancyBboxPatch, Polygon
from scipy.ndimage import map_coordinates

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration
from services.inference.estimator import EstimatorSettings, HolePosePrior, TouchObservation, estimate_pose
from services.inference.estimator.synthetic import GuardedPush, TouchNoise, touch
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts
from services.inference.touch_choice.by_rule import next_touch
from services.operator.bench.pictures.kept.shots import wanted_from
from services.vision.light import linear_light, shown
from services.vision.locate import locate_rim
from services.vision.stereo import StereoModel

FOLDER = Path(__file__).parent / "figures"
PICTURES = Path("tests/pictures/set")
CHI2_95_2DOF = 5.991
TRIALS = 20


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of one page: ink, fine lines, fill of boxes, the peg, the hole, what is felt, what is true."""

    ink: str
    fine: str
    box: str
    peg: str
    hole: str
    felt: str
    true: str


THEMES = {
    "": Theme("#222222", "#8a8a8a", "#eef1f6", "#d9822b", "#4a6fa5", "#c23030", "#2b8a3e"),
    "-dark": Theme("#e6e6e6", "#8f96a3", "#2c3140", "#f0a44d", "#8fb3ea", "#ff7b72", "#69d58c"),
}
BOXES = {  # a service: middle, and what it does
    "operator": (0.9, 2.0, "command line,\nclient, live page"),
    "planning": (3.3, 2.0, "assembly, strategies,\ntrajectories"),
    "vision": (6.0, 3.3, "hole from two pictures"),
    "inference": (6.0, 2.0, "contact mechanics,\nestimator, networks"),
    "force_torque": (6.0, 0.7, "calibrate, compensate,\ncontact state"),
    "hardware": (9.0, 2.0, "arm, sensor, cameras,\nor the simulated cell"),
    "recorder": (0.9, 0.7, "every key, to MCAP"),
}


def services(theme: Theme) -> Figure:
    """Who asks whom (solid), and what streams to whom (dotted)."""
    figure, axes = _canvas(10.4, 4.1)
    width, height = 2.0, 0.92
    for name, (x, y, does) in BOXES.items():
        axes.add_patch(
            FancyBboxPatch(
                (x - width / 2, y - height / 2), width, height,
                boxstyle="round,pad=0.02,rounding_size=0.1", facecolor=theme.box, edgecolor=theme.fine,
            )
        )  # fmt: skip
        axes.text(x, y + 0.24, name, ha="center", va="center", fontsize=11.5, weight="bold")
        axes.text(x, y - 0.14, does, ha="center", va="center", fontsize=9, color=theme.ink)

    def arrow(start: tuple[float, float], end: tuple[float, float], dotted: bool, bend: float = 0.0) -> None:
        axes.add_patch(
            FancyArrowPatch(
                start, end, arrowstyle="-|>", mutation_scale=11, linewidth=1.2, shrinkA=0, shrinkB=0,
                linestyle=(0, (1.5, 2)) if dotted else "-", color=theme.hole if dotted else theme.ink,
                connectionstyle=f"arc3,rad={bend}",
            )
        )  # fmt: skip

    arrow((1.95, 2.0), (2.25, 2.0), False)
    for y in (3.3, 2.0, 0.7):
        arrow((4.35, 2.0 + 0.2 * np.sign(y - 2.0)), (4.95, y), False)
    arrow((7.05, 3.3), (8.3, 2.5), False)
    arrow((8.55, 2.5), (7.05, 3.5), True)
    arrow((8.3, 1.5), (7.05, 0.7), True)
    axes.plot([3.3, 3.3, 9.4], [2.5, 4.0, 4.0], color=theme.ink, linewidth=1.2)
    arrow((9.4, 4.0), (9.4, 2.5), False)
    axes.text(6.3, 4.07, "trajectories, guarded moves, compliant pushes", ha="center", fontsize=9, color=theme.ink)
    axes.text(8.25, 3.2, "capture, images", fontsize=9, color=theme.ink)
    axes.text(8.0, 0.85, "raw wrench, joints", fontsize=9, color=theme.ink)
    axes.set(xlim=(-0.2, 10.2), ylim=(-0.25, 4.3))
    return figure


STEPS = [
    ("locate", "two pictures:\npose and covariance"),
    ("approach", "quintic trajectory\nto before the hole"),
    ("push", "yielding, until in\nor stuck"),
    ("press", "four walls of the\nbore: pose T2"),
    ("done", "T2 known; withdraw\nor the next peg"),
]
RETRY = [
    ("touch", "guarded move,\nuntil contact"),
    ("estimate", "all touches,\none pose"),
    ("correct", "to the new\nestimate"),
]


def assembly(theme: Theme) -> Figure:
    """The steps of an assembly by the default strategy."""
    figure, axes = _canvas(10.4, 2.9)

    def box(x: float, y: float, name: str, does: str, colour: str) -> None:
        axes.add_patch(
            FancyBboxPatch(
                (x - 0.85, y - 0.42), 1.7, 0.84, boxstyle="round,pad=0.02,rounding_size=0.1",
                facecolor=theme.box, edgecolor=colour,
            )
        )  # fmt: skip
        axes.text(x, y + 0.22, name, ha="center", va="center", fontsize=11.5, weight="bold")
        axes.text(x, y - 0.14, does, ha="center", va="center", fontsize=9)

    def arrow(start: tuple[float, float], end: tuple[float, float], text: str = "") -> None:
        axes.add_patch(
            FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=11, color=theme.ink, shrinkA=0, shrinkB=0)
        )
        if text:
            x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
            axes.text(x, y + 0.12, text, fontsize=9, ha="center", color=theme.ink)

    for index, (name, does) in enumerate(STEPS):
        box(1.0 + 2.1 * index, 2.0, name, does, theme.hole)
        if index:
            arrow((1.0 + 2.1 * index - 1.23, 2.0), (1.0 + 2.1 * index - 0.87, 2.0))
    for index, (name, does) in enumerate(RETRY):
        box(3.1 + 2.1 * index, 0.6, name, does, theme.peg)
        if index:
            arrow((3.1 + 2.1 * index - 1.23, 0.6), (3.1 + 2.1 * index - 0.87, 0.6))
    arrow((4.75, 1.56), (3.5, 1.04))
    axes.text(3.42, 1.3, "stuck", fontsize=9, ha="center")
    arrow((6.9, 1.04), (5.65, 1.56))
    axes.text(6.95, 1.3, "push again", fontsize=9, ha="center")
    axes.set(xlim=(0.0, 10.4), ylim=(0.05, 2.55))
    return figure


def contact(theme: Theme) -> Figure:
    """One contact of the tapered cross with the rim, seen along the axis and from the side, by the mechanics' code."""
    workcell = Workcell()
    peg = workcell.peg.shape()
    hole = workcell.hole.shape(peg)
    tables = PairTables.of(peg, hole)
    angles, offset = np.array([0.05, 0.02, 0.07]), np.array([0.0015, -0.0005])
    axis = np.array([0.0, 0.0, 1.0])
    to_hole = rotation_from_error_angles(angles).T
    shift = -(to_hole @ np.array([*offset, peg.tip_m + 0.01]))
    found = first_contacts(tables, to_hole[None], shift[None], (to_hole @ axis)[None])
    first = int(found.travel_m[0].argmin())
    shift = shift + float(found.travel_m[0, first]) * (to_hole @ axis)
    geometry = contact_geometry(found.features[:, first], to_hole[None], shift[None])
    point, normal = geometry.point_peg_m[0], geometry.normal_peg[0]
    wrench = contact_wrench_basis(normal[None], point[None], axis[None], 0.0)[0]
    rim_peg = (hole.inner_rim_m() - shift) @ to_hole * 1e3
    section = peg.outline_m(float(point[2]))[:, :2] * 1e3
    body = peg.outline_m(0.0)[:, :2] * 1e3

    figure, (plan, side) = plt.subplots(1, 2, figsize=(8.6, 4.0), gridspec_kw={"width_ratios": [1, 1.05]})
    plan.add_patch(Polygon(body, closed=True, fill=False, edgecolor=theme.peg, linewidth=0.8, linestyle=":"))
    plan.add_patch(Polygon(section, closed=True, facecolor=theme.peg, alpha=0.35, edgecolor=theme.peg, linewidth=1.4))
    plan.add_patch(Polygon(rim_peg[:, :2], closed=True, fill=False, edgecolor=theme.hole, linewidth=1.8))
    p = point * 1e3
    plan.plot(*p[:2], "o", color=theme.felt, markersize=6, zorder=5)
    _force(plan, p[:2], wrench[:2], theme)
    plan.annotate("P", p[:2], textcoords="offset points", xytext=(6, -13), color=theme.felt)
    plan.set(xlabel="x, mm", ylabel="y, mm", xlim=(-36, 36), ylim=(-36, 36), aspect="equal")
    plan.set_title("along the axis, at the height of the contact", fontsize=9)
    plan.text(-34, 31.5, "rim of the hole", color=theme.hole, fontsize=8)
    plan.text(-34, 28.0, "section of the peg", color=theme.peg, fontsize=8)

    # seen across the edge that touches: how far it is from the axis, over z
    across = wrench[:2] / np.linalg.norm(wrench[:2])
    heights = np.linspace(0.0, peg.tip_m, 200)
    scales = np.array([float(np.asarray(peg.scale_at(height))) for height in heights])
    edge = float(point[:2] @ across) / float(np.asarray(peg.scale_at(float(point[2])))) * scales * 1e3
    side.fill_betweenx(heights * 1e3, edge, -edge, color=theme.peg, alpha=0.35, linewidth=0)
    for sign in (-1, 1):
        side.plot(sign * edge, heights * 1e3, color=theme.peg, linewidth=1.4)
    here = np.array([point[:2] @ across, point[2]]) * 1e3
    push = np.array([wrench[:2] @ across, wrench[2]])
    facing = float(np.sign(here[0]))
    corners = [[here[0], here[1]], [facing * 30, here[1]], [facing * 30, here[1] + 9], [here[0], here[1] + 9]]
    side.add_patch(Polygon(corners, closed=True, facecolor=theme.hole, alpha=0.4, edgecolor=theme.hole))
    side.plot(*here, "o", color=theme.felt, markersize=6, zorder=5)
    _force(side, here, push, theme)
    side.text(-3.0, here[1] - 6.0, "F along M₁N₁ × D₁D₂", color=theme.felt, fontsize=8)
    side.annotate("", (0, 76), (0, 64), arrowprops={"arrowstyle": "-|>", "color": theme.ink})
    side.text(1.2, 75, "pushed", fontsize=8)
    side.text(facing * 20, here[1] + 5.5, "plate", ha="center", color=theme.hole, fontsize=8)
    side.set(xlabel="across the edge that touches, mm", ylabel="z along the peg, mm", xlim=(-30, 30), ylim=(84, 30))
    side.set_aspect("equal", adjustable="box")
    side.set_title("across the edge that touches", fontsize=9)
    n_z0 = abs(wrench[2]) / np.linalg.norm(wrench[:3])
    side.text(-29, 34, f"n$_{{z0}}$ = |F$_z$| / |F| = {n_z0:.3f}", fontsize=8)
    figure.tight_layout()
    return figure


def _force(axes: Axes, at: Array, force: Array, theme: Theme) -> None:
    length = 12.0
    direction = np.asarray(force) / max(float(np.linalg.norm(force)), 1e-9)
    axes.annotate(
        "",
        at + length * direction,
        at,
        arrowprops={"arrowstyle": "-|>", "color": theme.felt, "linewidth": 2.0},
        zorder=6,
    )


@cache
def _trials() -> tuple[Array, list[tuple[Array, Array]]]:
    """Errors (trials, touches + 1, 2), mm and degrees; of the first trial the mean and covariance of the place."""
    workcell = Workcell()
    peg = workcell.peg.shape()
    tables = PairTables.of(peg, workcell.hole.shape(peg))
    settings = EstimatorSettings(friction_mean=workcell.friction_expected)
    compliance = workcell.compliance_peg(np.asarray(workcell.home_joints_rad))
    nominal = workcell.hole_prior.pose_base_hole()
    sd = np.array([3e-3, 3e-3, 3e-3, 0.05, 0.05, 0.05])
    made: list[list[tuple[float, float]]] = []
    first: list[tuple[Array, Array]] = []
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        error = rng.normal(size=6) * sd
        truth = nominal @ Pose.from_rotvec(error[3:], error[:3]).inverse()
        prior = HolePosePrior(nominal, np.diag(sd**2))
        belief, covariance, used = nominal, np.diag(sd**2), True
        felt: list[TouchObservation] = []
        errors = [_errors(belief, truth)]
        steps = [_in_truth(belief, covariance, truth)]
        for attempt in range(8):
            plan = next_touch(peg, belief, covariance, attempt, attempt, last_touch_used=used)
            one = touch(
                tables,
                truth,
                plan.pose_base_peg_start,
                plan.direction_base,
                compliance,
                0.1,
                rng,
                TouchNoise(),
                GuardedPush(),
            )
            if one is None or len(felt) == 4:
                continue
            felt.append(one.observation)
            found = estimate_pose(tables, prior, felt, np.random.default_rng(seed), settings)
            belief, covariance, used = found.pose_base_hole, found.covariance, found.touches[-1].used
            errors.append(_errors(belief, truth))
            steps.append(_in_truth(belief, covariance, truth))
        if len(errors) == 5:
            made.append(errors)
            first = first or steps
    return np.array(made), first


def touches(theme: Theme) -> Figure:
    """The error that each touch leaves: one trial as ellipses, all as errors; touches made by the mechanics."""
    errors_of, shown_steps = _trials()
    figure, (where, how) = plt.subplots(1, 2, figsize=(8.6, 3.8))
    colours = plt.get_cmap("viridis")(np.linspace(0.1, 0.9, len(shown_steps)))
    for index, (mean, spread) in enumerate(shown_steps):
        values, vectors = np.linalg.eigh(spread)
        size = 2.0 * np.sqrt(np.maximum(values, 0.0) * CHI2_95_2DOF) * 1e3
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        middle = (float(mean[0] * 1e3), float(mean[1] * 1e3))
        region = Ellipse(middle, float(size[1]), float(size[0]), angle=angle, fill=False, linewidth=1.8)
        region.set(edgecolor=colours[index], label=f"after {index}")
        where.add_patch(region)
        where.plot(*(mean * 1e3), "o", color=colours[index], markersize=4)
    where.plot(0, 0, "+", color=theme.true, markersize=14, markeredgewidth=2, label="truth")
    where.set(
        xlabel="x, mm", ylabel="y, mm", xlim=(-11, 11), ylim=(-9, 9), title="one trial: 95 % region of the hole's place"
    )
    where.set_aspect("equal", adjustable="box")
    where.legend(fontsize=8, frameon=False, loc="upper right", title="touches", title_fontsize=8)
    counts = np.arange(errors_of.shape[1])
    for index, (name, unit, colour) in enumerate((("across the axis", "mm", theme.peg), ("rotation", "°", theme.hole))):
        middle, high = np.percentile(errors_of[..., index], [50, 95], axis=0)
        how.plot(counts, middle, "-o", color=colour, label=f"{name}, {unit}: p50")
        how.plot(counts, high, ":o", color=colour, markersize=3, label=f"{name}, {unit}: p95")
    how.set(yscale="log", xlabel="touches", ylabel="error", xticks=counts, title=f"{len(errors_of)} trials: error left")
    how.legend(fontsize=8, frameon=False)
    figure.tight_layout()
    return figure


def _errors(belief: Pose, truth: Pose) -> tuple[float, float]:
    off = belief.inverse() @ truth
    return float(np.hypot(*off.translation_m[:2])) * 1e3, float(np.degrees(np.linalg.norm(off.rotvec_rad())))


def _in_truth(belief: Pose, covariance: Array, truth: Pose) -> tuple[Array, Array]:
    """Mean (2,) and covariance (2, 2) of the lateral place, in the true hole's frame, m."""
    turn = (truth.inverse() @ belief).rotation
    spread = turn @ covariance[:3, :3] @ turn.T
    return np.asarray((truth.inverse() @ belief).translation_m[:2]), np.asarray(spread[:2, :2])


def rim(theme: Theme) -> Figure:
    """A path-traced picture with the rim that vision fitted, and the grey across one edge of it."""
    shot = wanted_from(PICTURES, ["metal_soft"], 1)[0].load()
    workcell = Workcell() if shot.peg is None else Workcell.model_validate({"peg": shot.peg})
    stereo = StereoModel.of(CameraCalibration.model_validate({"stamp_ns": 0, **shot.calibration}))
    prior, hole = workcell.hole_prior, workcell.hole.shape(workcell.peg.shape())
    located = locate_rim(shot.left, shot.right, stereo, hole, prior.pose_base_hole(), prior.half_ranges())
    to_camera = stereo.pose_base_camera.inverse() @ located.pose_base_hole
    grey = linear_light(shot.left, "", stereo.left.gamma)
    figure, (picture, profile) = plt.subplots(1, 2, figsize=(8.6, 3.8))
    picture.imshow(shown(grey, stereo.left.gamma), cmap="gray")
    lines = {"outer line": hole.outer_rim_m(), "inner line": hole.inner_rim_m()}
    middle = stereo.project(to_camera.translation_m)[0]
    for (name, line), colour in zip(lines.items(), (theme.true, theme.peg), strict=True):
        at = stereo.project(to_camera.apply(np.vstack([line, line[:1]])))[0]
        picture.plot(at[:, 0], at[:, 1], color=colour, linewidth=1.0, label=name)
    picture.set(xlim=(middle[0] - 75, middle[0] + 75), ylim=(middle[1] + 60, middle[1] - 60), xticks=[], yticks=[])
    picture.set_title("left picture, and the rim as fitted", fontsize=9)
    picture.legend(fontsize=8, loc="lower right", facecolor=theme.box)
    outer, inner = (stereo.project(to_camera.apply(line))[0] for line in lines.values())
    longest = int(np.argmax(np.linalg.norm(np.roll(outer, -1, axis=0) - outer, axis=1)))
    start, end = outer[longest], outer[(longest + 1) % len(outer)]
    along = (end - start) / np.linalg.norm(end - start)
    inward = np.array([-along[1], along[0]])
    inward *= np.sign(inward @ (inner[longest] - start))
    chamfer_px = float(inward @ (inner[longest] - start))
    far = np.arange(-6.0, 8.01, 0.25)
    ends = np.linspace(0.2, 0.8, 30)[:, None] * (end - start) + start
    points = ends[:, None] + far[None, :, None] * inward
    greys = map_coordinates(grey.astype(float), [points[..., 1], points[..., 0]], order=1)
    profile.plot(far, greys.T, color=theme.fine, linewidth=0.4, alpha=0.6)
    profile.plot(far, greys.mean(axis=0), color=theme.ink, linewidth=2.0, label="mean of 30 lines across")
    profile.axvline(0.0, color=theme.true, label="outer line, as fitted")
    profile.axvline(chamfer_px, color=theme.peg, label="inner line, as fitted")
    profile.set(xlabel="distance into the hole, px", ylabel="grey, linear light")
    profile.set_title("across its longest edge: face, chamfer, bore", fontsize=9)
    profile.legend(fontsize=8, frameon=False)
    figure.tight_layout()
    return figure


def _canvas(width: float, height: float) -> tuple[Figure, Axes]:
    figure, axes = plt.subplots(figsize=(width, height))
    axes.set_axis_off()
    figure.subplots_adjust(0, 0, 1, 1)
    return figure, axes


FIGURES: dict[str, Callable[[Theme], Figure]] = {
    "services": services, "assembly": assembly, "contact": contact, "touches": touches, "rim": rim,
}  # fmt: skip


def main() -> None:
    """Every figure, for both themes."""
    FOLDER.mkdir(exist_ok=True)
    mpl.rcParams.update({"svg.fonttype": "path", "svg.hashsalt": "crosspih", "font.size": 9})
    for suffix, theme in THEMES.items():
        colours = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
        with mpl.rc_context({name: theme.ink for name in colours}):
            for name, draw in FIGURES.items():
                figure = draw(theme)
                figure.savefig(FOLDER / f"{name}{suffix}.svg", transparent=True, metadata={"Date": None})
                plt.close(figure)


if __name__ == "__main__":
    main()
