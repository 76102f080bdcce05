"""Inference: from touches to the pose of the hole.

mechanics        a peg in contact with a hole: first contact, its wrench, a push on a compliant wrist
estimator        the hole's pose from touches, from presses in the bore, and from the seat, each with its covariance
touch_choice     where to touch next: by rule, or by the expected information of a touch
network          networks to compare the estimator with: the paper's, and one over histories of touches
cell_refinement  refines a cell's drawing and mountings from its past recordings
shell            the service on the bus: commands in, answers and refusals out
rate             `python -m services.inference.rate`: the CPU time of each answer
"""
