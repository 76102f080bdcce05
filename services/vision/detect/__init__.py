"""Find the hole near its prior by the drawing's outline, in both pictures, whatever the light."""

from services.vision.detect.candidate_poses import Candidate, candidates

__all__ = ["Candidate", "candidates"]
