"""Finds the hole near its prior by the outline of the drawing, in both pictures, in any light."""

from services.vision.detect.candidate_poses import Candidate, candidates

__all__ = ["Candidate", "candidates"]
