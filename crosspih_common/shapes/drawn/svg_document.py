"""An SVG file as XML: its elements, ids and style rules, its size and nesting kept within bounds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from crosspih_common.shapes.drawn.curves import MAX_BYTES, DrawingRefused
from crosspih_common.shapes.drawn.svg_styles import Rule, rules_of

SVG = "http://www.w3.org/2000/svg"
_DEEPEST = 200
_MAX_ELEMENTS = 300_000
_LONGEST_ENTITY = 200


@dataclass(frozen=True, slots=True)
class Document:
    """The root, what has an id, and the rules of all style sheets."""

    root: Element
    by_id: dict[str, Element]
    rules: list[Rule]


def local_name(element: Element) -> str | None:
    """The element's name where it is SVG's; None for the editors' own."""
    space, brace, name = element.tag.rpartition("}")
    return name if not brace or space == "{" + SVG else None


def read_document(path: Path) -> Document:
    """The file's elements. DrawingRefused where it is no SVG, too large, or grows as it is read."""
    if path.stat().st_size > MAX_BYTES:
        raise DrawingRefused(f"has more than {MAX_BYTES // 1_000_000} MB; simplify the drawing")
    try:
        root = _parsed(path.read_bytes())
    except (expat.ExpatError, OSError, UnicodeError, ValueError) as error:
        if isinstance(error, DrawingRefused):
            raise
        raise DrawingRefused(f"is no SVG: {error}") from None
    if local_name(root) != "svg":
        raise DrawingRefused(f"is no SVG: its root is {root.tag!r}")
    by_id: dict[str, Element] = {}
    sheets = []
    for element in root.iter():
        said = element.get("id")
        if said is not None:
            if said in by_id and local_name(element) is not None:
                raise DrawingRefused(f"two elements have the id {said!r}; give one another")
            by_id[said] = element
        if local_name(element) == "style":
            sheets.append("".join(element.itertext()))
    return Document(root, by_id, rules_of("\n".join(sheets)))


def _parsed(content: bytes) -> Element:
    """By expat, whose own guard against entities that expand without end is one of two."""
    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True
    builder = TreeBuilder()
    depth = count = 0

    def fixed(name: str) -> str:
        return "{" + name if "}" in name else name

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > _DEEPEST:
            raise DrawingRefused(f"its elements lie more than {_DEEPEST} deep; draw the outline without so many groups")
        if count > _MAX_ELEMENTS:
            raise DrawingRefused(f"holds more than {_MAX_ELEMENTS} elements; leave the peg's outline alone")
        builder.start(fixed(name), {fixed(key): value for key, value in attributes.items()})

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(fixed(name))

    def entity(name: str, parameter: int, value: str | None, *_rest: object) -> None:
        if parameter or value is None or "&" in value or len(value) > _LONGEST_ENTITY:
            raise DrawingRefused(f"declares the entity {name!r} that stands for other files or entities; write it out")

    def processing(target: str, data: str) -> None:
        if target == "xml-stylesheet":
            raise DrawingRefused("takes its style from another file (xml-stylesheet); put the style into the drawing")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler, parser.ProcessingInstructionHandler = entity, processing
    parser.Parse(content, True)
    return builder.close()
