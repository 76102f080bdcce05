"""Inference: from touches to the pose of the hole."""
