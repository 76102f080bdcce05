"""Inference: from touches to the pose of the hole.

mechanics        what a peg does that touches a hole: first contact, its wrench, a push on a compliant wrist
estimator        the hole's pose from touches, from presses in the bore, and from the seat, each with its covariance
touch_choice     where to touch next: by rule, or by what a touch should tell
network          the networks that the estimator is measured against: the paper's and one over histories of touches
cell_refinement  a cell's drawing and mountings refined over its past recordings
shell            the service on the bus: commands in, answers and refusals out
rate             `python -m services.inference.rate`: what each answer costs
"""
