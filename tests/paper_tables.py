"""Table 6 (three misprints mended: Mx of row 7, Mz of rows 4 and 5 interchanged) and Table 7 of the paper."""

import numpy as np

from services.inference.network.paper.dataset import ContactDataset

TABLE_6 = np.array(
    [
        [-19.115, -0.949, -5.448, -0.031, -1.239, 0.325],
        [-19.833, -1.806, -6.285, -0.007, -1.226, 0.375],
        [-17.606, -0.126, -4.485, -0.088, -1.046, 0.376],
        [-20.706, -0.542, -5.556, -0.098, -1.161, 0.481],
        [-15.283, -1.343, -4.804, 0.002, -0.977, 0.266],
        [-20.073, -0.809, -5.593, -0.063, -1.217, 0.403],
        [-19.654, -0.332, -5.145, -0.101, -1.113, 0.456],
        [-19.699, -1.912, -6.341, -0.014, -1.177, 0.399],
        [-18.935, -0.707, -5.251, -0.067, -1.132, 0.396],
        [-19.154, -1.281, -5.717, -0.043, -1.130, 0.398],
    ]
)
TABLE_7_RAD = np.array(
    [
        [0.07, 0.07, 0.07], [0.10, 0.04, 0.03], [0.02, 0.10, 0.05], [0.04, 0.06, 0.05], [0.10, 0.10, 0.04],
        [0.06, 0.05, 0.07], [0.03, 0.01, 0.05], [0.10, 0.01, 0.01], [0.04, 0.09, 0.01], [0.07, 0.03, 0.01],
    ]
)  # fmt: skip
FIRST_CONTACT = np.array([-19.247, -0.785, -5.3953, -0.044, -1.244, 0.339])
FITTED_SLOPE = 0.24884
FITTED_APEX_M = 0.08982


def paper_dataset() -> ContactDataset:
    """The ten printed rows; translations are not printed."""
    return ContactDataset(TABLE_6, TABLE_7_RAD, np.zeros((10, 3)), np.array(["1-2-2"] * 10))
