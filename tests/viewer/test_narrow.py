"""The page in a narrow window: the panel is below the view, and the whole cell in it."""

from __future__ import annotations

import gzip
import re
from math import tan
from pathlib import Path

import pytest

from services.viewer.gate import page_answer
from services.viewer.narrow import FOV_RAD, STYLE, WIDE_ENOUGH, WIDEST_RAD, upright_fov_rad


@pytest.mark.parametrize("aspect", [0.4, 0.49, 0.6, 0.7199])
def test_a_narrow_view_shows_as_much_from_side_to_side_as_one_that_is_wide_enough(aspect: float) -> None:
    assert tan(upright_fov_rad(aspect) / 2.0) * aspect == pytest.approx(tan(FOV_RAD / 2.0) * WIDE_ENOUGH)


def test_a_wide_view_stays_as_it_is_and_no_view_is_bent() -> None:
    assert upright_fov_rad(WIDE_ENOUGH) == upright_fov_rad(2.0) == FOV_RAD
    assert upright_fov_rad(0.05) == upright_fov_rad(0.0) == WIDEST_RAD


def test_the_sheet_that_is_moved_is_visers_own() -> None:
    viser = pytest.importorskip("viser", reason="the page wants viser: pip install 'crosspih[viewer]'")
    sheet = Path(viser.__file__).parent / "client" / "src" / "ControlPanel" / "BottomPanel.tsx"
    written = sheet.read_text(encoding="utf-8")
    for name, value in set(re.findall(r'style\*="([\w-]+): (\w+%?)"', STYLE)):
        camel = re.sub(r"-(\w)", lambda found: found[1].upper(), name)
        assert f'{camel}: "{value}"' in written, f"viser's sheet has no {name}: {value} any more"
    page = page_answer("<html><head></head></html>", "cell").partition(b"\r\n\r\n")[2]
    assert STYLE in gzip.decompress(page).decode()
