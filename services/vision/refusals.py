"""Refusals: why no pose is given. A confident wrong pose is worse than a refusal.

VisionRefusal
├── WrongImage         not a picture of this camera's size
├── TooDark            the plate is not bright enough to measure on
├── TooBright          the plate is so bright that the sensor is saturated
├── NoCross            nothing in the picture has the shape and size of the hole
├── TwoCrosses         more than one has
├── CutOff             the hole is at the edge of a picture
├── NotAStereoPair     the two pictures do not belong together: swapped, or a camera moved
├── NotTheDrawing      an outline, but not the drawing's, or not of its size
├── FlatPrint          what is seen inside lies in the face's plane: a print, a sticker
├── ShallowPocket      what is seen inside lies just below the face
├── NotSeenInside      nothing tells whether it is a hole or a print of one
├── NotEnoughRim       too much of the rim cannot be seen: covered, glare
├── PoorFit            the rim does not look like a rim
├── Doubtful           each check passes, all together do not
└── OutsidePrior       a hole, but not where the hole can be
"""

from __future__ import annotations


class VisionRefusal(Exception):
    """No pose. `code` is stable; the text gives the measured value and its bound. If not `certain`, it is the likeliest
    cause, and another light may show another one."""

    code = "vision"

    def __init__(self, text: str, certain: bool = True) -> None:
        super().__init__(text)
        self.certain: bool = certain


class WrongImage(VisionRefusal):
    """Not a picture of this camera's size."""

    code = "wrong_image"


class TooDark(VisionRefusal):
    """The plate is not bright enough to measure on."""

    code = "too_dark"


class TooBright(VisionRefusal):
    """The plate is so bright that the sensor is saturated: an edge there appears at the wrong place."""

    code = "too_bright"


class NoCross(VisionRefusal):
    """Nothing in the picture has the shape and size of the hole."""

    code = "no_cross"


class TwoCrosses(VisionRefusal):
    """More than one thing in the picture has the shape and size of the hole."""

    code = "two_crosses"


class CutOff(VisionRefusal):
    """The hole is at the edge of a picture."""

    code = "cut_off"


class NotAStereoPair(VisionRefusal):
    """The two pictures do not belong together: swapped, or a camera was moved."""

    code = "not_a_stereo_pair"


class NotTheDrawing(VisionRefusal):
    """An outline, but not the drawing's, or not of its size."""

    code = "not_the_drawing"


class FlatPrint(VisionRefusal):
    """What is seen inside lies in the face's plane, or is as even as ink in an outline of one step: a print."""

    code = "flat_print"


class ShallowPocket(VisionRefusal):
    """What is seen inside lies just below the face."""

    code = "shallow_pocket"


class NotSeenInside(VisionRefusal):
    """Evenly dark inside, and no chamfer to be seen: nothing tells a hole from a print of one."""

    code = "not_seen_inside"


class NotEnoughRim(VisionRefusal):
    """Too much of the rim cannot be seen."""

    code = "not_enough_rim"


class PoorFit(VisionRefusal):
    """The rim does not look like a rim."""

    code = "poor_fit"


class Doubtful(VisionRefusal):
    """Each check passes by itself; together they say that the fit has gone wrong."""

    code = "doubtful"


class OutsidePrior(VisionRefusal):
    """A hole, but not where the hole can be."""

    code = "outside_prior"
