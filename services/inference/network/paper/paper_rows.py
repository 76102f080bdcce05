"""The ten samples that the paper prints (its Tables 6 and 7), as a data set."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from services.inference.network.paper.dataset import ContactDataset

ROWS = Path(__file__).with_name("paper_rows.json")


def paper_rows() -> ContactDataset:
    """Ten contacts of state 1-2-2; their translations are not printed and stand as zeros."""
    content = json.loads(ROWS.read_text(encoding="utf-8"))
    wrench, angles = np.array(content["wrench"], float), np.array(content["angles_rad"], float)
    return ContactDataset(wrench, angles, np.zeros((len(wrench), 3)), np.array([content["state"]] * len(wrench)))
