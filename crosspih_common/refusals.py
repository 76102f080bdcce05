"""Every refusal code of commands and its meaning; a test compares the table with the source.

A refusal is the error reply of a query: the code, a newline, and a text for people that says what is wrong and how to
correct it. Programs use the code alone.
"""

from __future__ import annotations

# code: what it means for the caller
REFUSALS: dict[str, str] = {
    # by the bus, from any service
    "contract": "the request is not what its key promises: no label, another type or version, or fields that do not "
    "validate; the text names the field",
    "not_yours": "it changes a calibration, and whoever asks has not claimed the name of a service that may",
    "busy": "another motion or assembly is being carried out; nothing was queued, ask again when it has ended",
    "stopping": "the service was stopped while it carried the command out; it may be half done",
    "internal": "a defect in the service; the text holds the exception",
    "no_service": "a service that was asked in turn is not there",
    "command_timeout": "a service that was asked in turn did not answer in time",
    "bad_answer": "a service that was asked in turn answered with something that is not what its key promises",
    "bus_unreachable": "the router was lost while another service was asked",
    "config": "the cell's file says something that cannot be",
    "implausible": "numbers that no such cell can have; the text names the field and the most that is taken",
    # arm
    "not_finite": "a number is not finite, or a quaternion is zero",
    "direction": "a direction has no length",
    "unreachable": "a pose or a point of the way has no joint angles, or the way would jump between two of them",
    "joints": "a joint vector has not as many numbers as the arm has joints",
    "joint_limit": "a joint would leave its range; the text names the joint and where on the way",
    "speed_limit": "a joint would be faster than its limit; go slower or stay away from the singularity",
    "acceleration_limit": "a joint would accelerate more than its limit; give the segment more time",
    "wrong_start": "the first knot is not where the arm is; plan from the present joint state",
    "knots": "times do not rise by 1 ms or more from knot to knot, or the first or last knot is not at rest",
    "path": "an admittance move's search path has times that do not rise by 1 ms or more",
    "cap": "no speed would keep the motion under the force cap; the text names the field and the most that is allowed",
    "size": "the motion would take longer than the cell allows",
    "collision": "a part of the arm would come too near to something of cell.surroundings; the text names both",
    "implausible_payload": "the payload does not fit what the sensor reads at rest, its range, or gravity",
    "no_payload": "a move that goes by force, before arm/set_payload: set the payload first (`crosspih calibrate ft`)",
    "no_strategy": "a strategy of one's own cannot be loaded, or the cell's file does not allow it; the text says why",
    "own_code": "an estimator or network of one's own failed, or answered what is no pose; the text names it",
    "held": "somebody else holds the arm; the text names the holder",
    "no_lease": "the motion names no lease, or not the present one; take it first and keep it by beats",
    "device_lost": "a device does not answer or may not move: protective stop, power off, cable out; the text names it "
    "and the mend. A motion that was under way has ended; the next one works when the device is back",
    # a recording played back as a cell
    "not_recorded": "a recording cannot be steered: the motion, the picture or the light that was asked for is not in "
    "it at that time; the text says what is",
    # cameras
    "camera_away": "a camera does not answer, or sends no pictures; the text says which one and what to look at",
    "incomplete_picture": "parts of a picture were lost on the way, also when it was taken again",
    "exposed_apart": "the two cameras did not expose together, also when asked again",
    # simulation
    "peg_in_contact": "place_peg puts the peg into the fixture; place it free",
    # vision
    "switched_off": "vision is switched off in the cell's file",
    "no_image": "a picture of the pair did not arrive in time; ask again",
    "vision": "no pose, for a reason that has no code of its own",
    "wrong_image": "a picture is not of the size that the calibration says",
    "too_dark": "the plate is not bright enough to measure on",
    "too_bright": "the plate is so bright that the sensor is saturated",
    "no_cross": "nothing in the picture has the shape and size of the hole",
    "two_crosses": "more than one thing in the picture has the shape and size of the hole",
    "cut_off": "the hole is at the edge of a picture",
    "not_a_stereo_pair": "the two pictures do not belong together: swapped, or a camera was moved",
    "not_the_drawing": "an outline, but not the drawing's, or not of its size",
    "flat_print": "what is seen inside the outline lies in the face's plane: a print or a sticker",
    "shallow_pocket": "what is seen inside the outline lies just below the face",
    "not_seen_inside": "nothing in the pictures tells whether it is a hole or a print of one",
    "not_enough_rim": "too much of the rim cannot be seen",
    "poor_fit": "the rim does not look like a rim",
    "doubtful": "each check passes by itself; together they say that the fit has gone wrong",
    "outside_prior": "a hole, but not where the hole can be",
    # force_torque
    "calibration": "bias, weight and centroid cannot be found from these readings; the text says which pose is missing "
    "or does not fit",
    "not_calibrated": "the sensor was never calibrated, or its calibration failed",
    "lengths": "two lists that belong together are not of one length",
    # inference
    "no_torch": "torch is not installed, which the networks alone need; the text says how to get it",
    "not_seated": "the peg's pose says that it does not sit in the hole",
    "no_weights": "the network has no weights for this peg; train it first",
    # recorder
    "unwritable": "no recording can be made in the recorder's directory",
    # planning/abort
    "stop": "the arm could not be told to stop; it may still move",
    # planning, with the names of an assembly's failures
    "not_seen": "vision refused",
    "not_converged": "the attempts are used up",
    "overload": "the cell's force or moment cap stopped the arm once too often",
    "refused": "a service said no to a command",
    "service_lost": "a service did not answer in time, also when asked again",
    "aborted": "somebody stopped it",
    "arm_stopped": "the arm broke a motion off by itself: its holder, its cycles or its sensor were lost",
    "defect": "an error in the planner itself",
    "cell_unfit": "two cells tick on the same keys, no clock ticks, or a stream stands still; nothing was moved",
    "stuck": "the peg is held fast where it sits",
}
