"""The styling in SVG that decides whether and where a shape is drawn: attributes, `style`, and style sheets.

Selectors by element name, class or id are understood; any other is refused if its rule has a relevant property.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from crosspih_common.shapes.drawn.curves import DrawingRefused

INHERITED = ("visibility", "fill", "stroke", "fill-opacity", "stroke-opacity", "stroke-width", "color")
_HERE = ("display", "opacity", "clip-path", "clip", "mask", "filter", "overflow")
_MARKERS = ("marker", "marker-start", "marker-mid", "marker-end")
_MATTERS = frozenset((*INHERITED, *_HERE, *_MARKERS))
# of CSS alone: each would move or shape something
_GEOMETRY = frozenset([
    "transform", "transform-origin", "translate", "rotate", "scale", "d", "cx", "cy", "r", "rx", "ry", "x", "y",
    "width", "height", "offset", "offset-path", "zoom", "all", "content-visibility", "mask-image", "-webkit-mask",
    "-webkit-mask-image", "-webkit-clip-path", "animation", "animation-name", "points",
])  # fmt: skip
_DEFAULTS = {
    "display": "inline", "opacity": "1", "visibility": "visible", "fill": "black", "stroke": "none",
    "fill-opacity": "1", "stroke-opacity": "1", "stroke-width": "1", "color": "black", "clip-path": "none",
    "clip": "auto", "mask": "none", "filter": "none", "overflow": "",
}  # fmt: skip
_SELECTOR = re.compile(r"(\*|[A-Za-z][\w-]*)?((?:[.#][\w-]+)*)")
_RULE = re.compile(r"([^{}]*)\{([^{}]*)\}")
_CLEAR = re.compile(r"(rgba|hsla|rgb|hsl)\(.*[,/]\s*0*\.?0*%?\s*\)|#[0-9a-f]{6}00|#[0-9a-f]{3}0")


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule of a style sheet: the selector, its rank, and what it says."""

    tag: str
    classes: frozenset[str]
    ids: frozenset[str]
    said: dict[str, tuple[str, bool]]

    @property
    def rank(self) -> tuple[int, int, int]:
        """How specific it is."""
        return len(self.ids), len(self.classes), int(self.tag not in ("", "*"))

    def meets(self, tag: str, element: Element) -> bool:
        """Whether it is about an element."""
        if self.tag not in ("", "*", tag):
            return False
        if self.ids - {element.get("id", "")}:
            return False
        return not self.classes - set(element.get("class", "").split())


def rules_of(sheet: str) -> list[Rule]:
    """The rules of a style sheet, in order. DrawingRefused where one that matters is not understood."""
    text = re.sub(r"/\*.*?\*/", " ", sheet, flags=re.DOTALL).replace("<!--", " ").replace("-->", " ")
    text = re.sub(r"@charset[^;]*;", " ", text)
    text = re.sub(r"@(font-face|namespace)[^{;]*(\{[^{}]*\}|;)", " ", text)
    if "@" in text:
        rule = text[text.index("@") :].split("{")[0].strip()[:40]
        raise DrawingRefused(f"style: {rule!r} is not understood; write what it says on the shapes themselves")
    if _RULE.sub("", text).strip():
        raise DrawingRefused(f"style: {_RULE.sub('', text).strip()[:40]!r} is not understood; mend the style sheet")
    rules = []
    for selectors, body in _RULE.findall(text):
        said = declarations("style", body)
        for selector in selectors.split(","):
            found = _SELECTOR.fullmatch(selector.strip())
            if found is not None and selector.strip():
                names = re.findall(r"([.#])([\w-]+)", found[2])
                classes, ids = ({name for sign, name in names if sign == wanted} for wanted in ".#")
                rules.append(Rule(found[1] or "", frozenset(classes), frozenset(ids), said))
            elif said:
                raise DrawingRefused(
                    f"style: the selector {selector.strip()[:40]!r} is not understood and says {', '.join(said)}; "
                    f"write it on the shapes themselves"
                )
    return sorted(rules, key=lambda rule: rule.rank)


def declarations(entity: str, body: str) -> dict[str, tuple[str, bool]]:
    """What a style says of what matters: by property its value, and whether it is important."""
    said: dict[str, tuple[str, bool]] = {}
    for part in body.split(";"):
        name, colon, value = part.partition(":")
        name, value = name.strip().lower(), value.strip()
        if not colon:
            continue
        if name in _GEOMETRY and value.lower() not in ("none", "auto", "initial"):
            raise DrawingRefused(f"{entity}: the style says {name}: {value[:30]}; write it as an attribute")
        if name not in _MATTERS:
            continue
        important = bool(re.search(r"!\s*important$", value))
        value = re.sub(r"\s*!\s*important$", "", value).strip()
        if "var(" in value or "calc(" in value:
            raise DrawingRefused(f"{entity}: the style says {name}: {value[:30]}, which is reckoned; write the value")
        if important or not said.get(name, ("", False))[1]:
            said[name] = (value, important)
    return said


def style_of(entity: str, tag: str, element: Element, rules: list[Rule], above: dict[str, str]) -> dict[str, str]:
    """What holds for an element: `above` is what holds for its parent."""
    said: dict[str, tuple[str, bool]] = {
        name: (element.get(name, "").strip(), False) for name in _MATTERS if element.get(name) is not None
    }
    for rule in (*rules, None):
        if rule is not None and not rule.meets(tag, element):
            continue
        more = declarations(entity, element.get("style", "")) if rule is None else rule.said
        for name, (value, important) in more.items():
            if important or not said.get(name, ("", False))[1]:
                said[name] = (value, important)
    result = {**_DEFAULTS, **{name: above[name] for name in INHERITED if name in above}}
    for name, (value, _) in said.items():
        low = value.lower()
        if low == "inherit":
            result[name] = above.get(name, _DEFAULTS.get(name, "none"))
        elif low in ("initial", "unset", "revert"):
            result[name] = (
                above.get(name, "") if low != "initial" and name in INHERITED else _DEFAULTS.get(name, "none")
            )
        else:
            result[name] = value if value.startswith("url(") else low
    return result


def is_none(value: str) -> bool:
    """Whether a number or share of a style is nothing."""
    try:
        return float(value.strip().rstrip("%")) <= 0.0
    except ValueError:
        return False


def unpainted(style: dict[str, str], area: bool) -> str | None:
    """Why a shape with that style is not seen; None where it is. `area`: a fill has something to fill."""

    def clear(paint: str, opacity: str) -> bool:
        colour = style["color"] if style[paint] == "currentcolor" else style[paint]
        return colour in ("none", "transparent") or bool(_CLEAR.fullmatch(colour)) or is_none(style[opacity])

    no_stroke = clear("stroke", "stroke-opacity") or is_none(style["stroke-width"].rstrip("pxmcint"))
    if style["visibility"] in ("hidden", "collapse"):
        return f"visibility: {style['visibility']}"
    if no_stroke and (clear("fill", "fill-opacity") or not area):
        return "neither fill nor stroke"
    return None


def markers(style: dict[str, str]) -> bool:
    """Whether something is drawn on the shape's points."""
    return any(style.get(name, "none") not in ("none", "") for name in _MARKERS)
