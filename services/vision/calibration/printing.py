"""A board to print: a one-page PDF in true size, drawn from rectangles, or a PNG that states its resolution."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from services.vision.calibration.boards import Board

POINTS_A_METRE = 72.0 / 0.0254
MARGIN_M = 0.012
RULER_M = 0.1
PNG_DOTS_A_METRE = 11811  # 300 dpi


def pdf_of(board: Board) -> bytes:
    """One page as large as the board and a margin, with a ruler of 100 mm to check the print by."""
    width, height = board.pattern.size_m
    page = np.array([max(width, RULER_M) + 2 * MARGIN_M, height + 3 * MARGIN_M]) * POINTS_A_METRE
    lines = ["0 g"]
    for left, top, across, down in board.black_m():
        x = (MARGIN_M + left) * POINTS_A_METRE
        y = page[1] - (MARGIN_M + top + down) * POINTS_A_METRE
        lines.append(f"{x:.5f} {y:.5f} {across * POINTS_A_METRE:.5f} {down * POINTS_A_METRE:.5f} re")
    lines.append("f")
    start, end, base = (value * POINTS_A_METRE for value in (MARGIN_M, MARGIN_M + RULER_M, 0.6 * MARGIN_M))
    lines.append(f"0.5 w {start:.5f} {base:.5f} m {end:.5f} {base:.5f} l S")
    for at in (start, end):
        lines.append(f"{at:.5f} {base - 4:.5f} m {at:.5f} {base + 4:.5f} l S")
    said = f"{board.pattern}   the line is 100 mm: print at 100 %, without fitting to the page"
    lines.append(f"BT /F1 7 Tf {start:.3f} {base + 6:.3f} Td ({said}) Tj ET")
    stream = "\n".join(lines).encode("ascii")
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {page[0]:.5f} {page[1]:.5f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>".encode("ascii"),
        f"<< /Length {len(stream)} >>\nstream\n".encode("ascii") + stream + b"\nendstream",
    ]
    written, places = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, 1):
        places.append(len(written))
        written += f"{number} 0 obj\n".encode("ascii") + body + b"\nendobj\n"
    at_table = len(written)
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    written += (
        f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\n"
        f"startxref\n{at_table}\n%%EOF\n"
    ).encode("ascii")
    return written


def png_of(board: Board) -> bytes:
    """The same squares without a ruler, 8-bit grey at 300 dpi; the file states the resolution (pHYs)."""
    dots = PNG_DOTS_A_METRE
    width, height = np.rint((board.pattern.size_m + 2 * MARGIN_M) * dots).astype(int)
    picture = np.full((height, width), 255, dtype=np.uint8)
    for left, top, across, down in board.black_m():
        x0, y0, x1, y1 = np.rint(np.array([left, top, left + across, top + down]) * dots + MARGIN_M * dots).astype(int)
        picture[y0:y1, x0:x1] = 0
    rows = b"".join(b"\0" + row.tobytes() for row in picture)
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", dots, dots, 1)),
        (b"IDAT", zlib.compress(rows, 9)),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts
    )


def write_board(board: Board, path: Path) -> None:
    """Write a .pdf or .png, by the file name's ending. Raises ValueError for another ending."""
    makers = {".pdf": pdf_of, ".png": png_of}
    maker = makers.get(path.suffix.lower())
    if maker is None:
        raise ValueError(f"{path}: name a file that ends in .pdf or .png")
    path.write_bytes(maker(board))
