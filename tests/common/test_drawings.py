"""Outlines from SVG and DXF files, and the peg's section of a cell's file: known answers, and errors with the mend."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ezdxf.document import Drawing

from crosspih_common.config import PegDrawing, load_cell
from crosspih_common.config.drawing import peg_section
from crosspih_common.errors import ConfigError
from crosspih_common.shapes.importing import MAX_CORNERS, outline_from_file

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="60mm" viewBox="0 0 60 60">'


def _svg(folder: Path, content: str, head: str = HEAD) -> Path:
    path = folder / "drawn.svg"
    path.write_text(f"{head}{content}</svg>", encoding="utf-8")
    return path


def _dxf(folder: Path, unit: int = 4) -> tuple[Path, Drawing]:
    document = Drawing.new()
    document.units = unit
    return folder / "drawn.dxf", document


def test_a_polygon_comes_in_millimetres_centred_with_y_up(tmp_path: Path) -> None:
    # a triangle whose lone corner is at the top of the page
    outline = outline_from_file(_svg(tmp_path, '<polygon points="10,40 40,40 25,10"/>'))
    corners = outline.corners_m * 1e3
    top = corners[np.argmax(corners[:, 1])]
    np.testing.assert_allclose(top, [0.0, 20.0], atol=1e-5)
    assert outline.area_m2 == pytest.approx(450e-6, rel=1e-5)
    assert outline.name == "drawn"


def test_transforms_and_units_of_an_svg_count(tmp_path: Path) -> None:
    turned = '<g transform="rotate(30 30 30)"><rect x="20" y="25" width="20" height="10"/></g>'
    outline = outline_from_file(_svg(tmp_path, turned))
    assert outline.area_m2 == pytest.approx(200e-6, rel=1e-5)
    assert outline.symmetry_order == 2
    in_inches = HEAD.replace('"60mm" height="60mm"', '"1in" height="1in"')
    scaled = outline_from_file(_svg(tmp_path, turned, in_inches))
    assert scaled.area_m2 == pytest.approx(200e-6 * (25.4 / 60.0) ** 2, rel=1e-5)


def test_circles_of_both_formats_are_the_same_round(tmp_path: Path) -> None:
    path, document = _dxf(tmp_path)
    document.modelspace().add_circle((5.0, -3.0), 20.0)
    document.saveas(path)
    for outline in (outline_from_file(path), outline_from_file(_svg(tmp_path, '<circle cx="30" cy="30" r="20"/>'))):
        assert outline.symmetry_order == 0
        assert len(outline.corners_m) == 64
        assert outline.radius_m == pytest.approx(0.02, rel=1e-5)
        assert outline.inner_radius_m > 0.02 - 5e-5


def test_lines_and_arcs_of_a_dxf_are_joined_in_its_unit(tmp_path: Path) -> None:
    path, document = _dxf(tmp_path, unit=5)  # centimetres
    space = document.modelspace()
    space.add_line((0.0, 0.0), (3.0, 0.0))
    space.add_line((0.0, 2.0), (0.0, 0.0))  # the other way round
    space.add_arc((3.0, 1.0), 1.0, -90.0, 90.0)
    space.add_line((3.0, 2.0), (0.0, 2.0))
    space.add_text("not part of it")
    document.saveas(path)
    outline = outline_from_file(path)
    assert outline.area_m2 == pytest.approx((6.0 + np.pi / 2.0) * 1e-4, rel=2e-3)


def test_curves_get_no_more_corners_than_a_cell_can_bear(tmp_path: Path) -> None:
    petals = "M 40 20 C 60 20 60 40 40 40 C 40 60 20 60 20 40 C 0 40 0 20 20 20 C 20 0 40 0 40 20 Z"
    outline = outline_from_file(_svg(tmp_path, f'<path d="{petals}"/>'))
    assert len(outline.corners_m) <= MAX_CORNERS
    assert outline.symmetry_order == 4
    assert np.count_nonzero(outline.reentrant) == 4


def test_an_outline_that_its_centroid_does_not_see_is_centred_where_it_is_seen(tmp_path: Path) -> None:
    outline = outline_from_file(_svg(tmp_path, '<polygon points="0,0 40,0 40,10 10,10 10,40 0,40"/>'))
    assert float(np.min(outline.offsets_m)) == pytest.approx(0.005, rel=1e-5)
    # the corner square of the L, its middle
    np.testing.assert_allclose(outline.corners_m.min(axis=0) * 1e3, [-5.0, -35.0], atol=1e-4)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            '<path id="p" d="M 10 10 L 40 10 L 40 40"/>',
            r"path 'p' is open: its ends are 42\.426 mm apart, at \(10\.000, 10\.000\) and",
        ),
        ('<polygon id="bow" points="0,0 30,30 30,0 0,30"/>', "polygon 'bow': Self-intersection.*cross or touch itself"),
        ('<circle id="a" cx="9" cy="9" r="5"/><rect width="2" height="2"/>', "holds 2 outlines .circle 'a', rect numb"),
        ('<text x="1" y="1">peg</text>', "holds no curve that is drawn .left out: text: a text.; draw"),
        ('<polygon points="0,0 40,0 40,40 0,40 0,30 30,30 30,10 0,10"/>', "axis .0, 0. is not inside it; move it"),
    ],
)
def test_what_is_wrong_with_an_svg_is_named(tmp_path: Path, content: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        outline_from_file(_svg(tmp_path, content))
    assert "drawn.svg" in str(caught.value)


def test_files_without_a_unit_or_that_are_no_drawings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"svg: width has no unit of length .got '60'.; write it as "):
        outline_from_file(_svg(tmp_path, "<rect/>", HEAD.replace('width="60mm"', 'width="60"')))
    path, document = _dxf(tmp_path, unit=0)
    document.modelspace().add_circle((0.0, 0.0), 20.0)
    document.saveas(path)
    with pytest.raises(ValueError, match=r"no unit of length .*set it, to 4 for millimetres"):
        outline_from_file(path)
    path.write_text("hello", encoding="utf-8")
    with pytest.raises(ValueError, match="is no DXF"):
        outline_from_file(path)
    with pytest.raises(ValueError, match="there is no such drawing"):
        outline_from_file(tmp_path / "none.svg")


def test_a_dxf_that_does_not_close_names_entity_and_layer(tmp_path: Path) -> None:
    path, document = _dxf(tmp_path)
    document.modelspace().add_line((0.0, 0.0), (30.0, 0.0), dxfattribs={"layer": "peg"})
    document.saveas(path)
    with pytest.raises(ValueError, match=r"LINE .* on layer peg is open: its ends are 30.000 mm apart"):
        outline_from_file(path)


def test_the_shipped_cells_load() -> None:
    for path in sorted(Path("deploy/cells").glob("*.yaml")):
        assert load_cell(path).workcell.peg.shape().pieces()


def _cell(folder: Path, peg: str) -> Path:
    path = folder / "cell.yaml"
    path.write_text(f"cell: {{peg: {peg}}}\n", encoding="utf-8")
    return path


def test_a_cell_names_its_peg_or_a_drawing_beside_it(tmp_path: Path) -> None:
    star = load_cell(_cell(tmp_path, "{outline: star, count: 6, tip_scale: 0.4}")).workcell.peg.shape()
    assert star.outline.symmetry_order == 6
    assert float(star.scale_at(star.tip_m)) == pytest.approx(0.4)
    _svg(tmp_path, '<circle cx="30" cy="30" r="20"/>')
    drawn = load_cell(_cell(tmp_path, "{outline: drawn.svg}")).workcell.peg.shape()
    assert drawn.outline.symmetry_order == 0


def test_a_drawing_written_out_needs_its_file_no_more(tmp_path: Path) -> None:
    path = _svg(tmp_path, '<polygon points="10,40 40,40 25,10"/>')
    section = peg_section(str(path))
    shape = PegDrawing.model_validate(section).shape()
    np.testing.assert_allclose(shape.outline.corners_m, outline_from_file(path).corners_m, atol=1e-9)
    assert peg_section("star") == {"outline": "star"}
    with pytest.raises(ConfigError, match="--peg: outline 'ster': want one of cross, square"):
        peg_section("ster")


@pytest.mark.parametrize(
    ("peg", "words"),
    [
        ("{outline: ster}", "cell.peg.*'ster': want one of cross, square, .* or a file that ends in .svg or .dxf"),
        ("{outline: star, half_width_m: 0.004}", "half_width_m means nothing for the outline 'star'; leave it out"),
        ("{outline: cross, radius_m: 0.02}", "radius_m means nothing for the outline 'cross'"),
        ("{outline: star, inner_radius_m: 0.04}", "inner_radius_m is 0.04, want less than radius_m, 0.027"),
        ("{outline: spline, count: 20}", "tooth_half_width_m is 0.004: 20 teeth so wide do not fit"),
        ("{outline: square, radius_m: 0.09}", "its rim reaches 64.7 mm .* take a smaller outline"),
        ("{outline: star, tip_m: 0.03}", "body_start_m < taper_start_m < tip_m < apex_m"),
        ("{outline: none.svg}", "none.svg: there is no such drawing"),
        (
            "{outline: slot, corners_m: [[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [0.004, 0.02], [0.004, 0.008], "
            "[-0.004, 0.008], [-0.004, 0.02], [-0.02, 0.02]]}",
            "axis does not see the wall that begins at .4.00, 20.00. mm",
        ),
    ],
)
def test_what_is_wrong_with_a_cells_peg_is_named(tmp_path: Path, peg: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_cell(_cell(tmp_path, peg))
