"""What the site needs beyond Markdown: MathML, pages of source files that the docs link to, and the root's own pages.

Loaded by mkdocs.yml. Nothing here reaches a network.

- `$...$` and `$$...$$` become MathML, which browsers draw themselves.
- A link to a file of the repository that is no page (a module, an example, a folder) leads to a page with its text.
- A link that is called by its file, as `[safety.md](safety.md)`, is called by the page's name in the navigation.
- CONTRIBUTING.md and CHANGELOG.md stand in the root, where repositories have them, and are pages of the site too.
- A picture `x.svg` with an `x-dark.svg` beside it is shown by the reader's theme.
"""

from __future__ import annotations

import ast
import html
import posixpath
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent.parent
DOCS = ROOT / "docs"
ROOT_PAGES = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
EXCLUDED = {".py", ".yaml", ".j2", ".json"}  # as mkdocs.yml has it: of docs/, but no part of the site as they are
LANGUAGES = {".py": "python", ".yaml": "yaml", ".yml": "yaml", ".toml": "toml", ".sh": "sh", ".svg": "xml"}
BY_FILE = re.compile(r"\[[\w./-]+\.md\]\(([\w./-]+\.md)(#[\w-]+)?\)")
FENCED = re.compile(r"^(```|~~~).*?^\1\s*$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(?<!!)\]\((?!https?:|mailto:|#)([^)\s#]+)(#[^)\s]*)?\)")
MATH = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
PICTURE = re.compile(r'<img ([^>]*?)src="([^"]+)\.svg"([^>]*)>')


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """A page that the navigation names and that is not there is left out; one that it lacks ends the build."""
    config.nav = _there(config.nav or [])
    return config


def _there(nav: list[Any]) -> list[Any]:
    kept: list[Any] = []
    for entry in nav:
        for name, value in entry.items() if isinstance(entry, dict) else [("", entry)]:
            if isinstance(value, list):
                kept.append({name: _there(value)})
            elif value in ROOT_PAGES or (DOCS / value).exists():
                kept.append(entry)
    return kept


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the root's pages, and one for each file or folder of the repository that a page links to."""
    for page, name in ROOT_PAGES.items():
        files.append(File.generated(config, page, content=_from_root((ROOT / name).read_text(encoding="utf-8"))))
    linked = {
        target
        for file in list(files.documentation_pages())
        for target in _linked_files(file.content_string, file.src_uri)
    }
    for target in sorted(linked):
        files.append(File.generated(config, _page_of(target), content=_source_page(target)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to files that are no pages lead to the pages that `on_files` made of them."""
    here = posixpath.dirname(page.file.src_uri)

    def other(found: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join("docs", here, found.group(1)))
        own = next((name for name, root in ROOT_PAGES.items() if root == path), None)
        if own is not None:
            return f"]({posixpath.relpath(own, here or '.')}{found.group(2) or ''})"
        target = _repository_path(found.group(1), page.file.src_uri)
        if target is None:
            return found.group(0)
        return f"]({posixpath.relpath(_page_of(target), here or '.')})"

    names = _names(config.nav or [])

    def by_name(found: re.Match[str]) -> str:
        link, anchor = found.groups()
        name = names.get(posixpath.normpath(posixpath.join(here, link)))
        return found.group(0) if name is None else f"[{name}]({link}{anchor or ''})"

    return _outside_fences(markdown, lambda text: LINK.sub(other, BY_FILE.sub(by_name, text)))


def _names(nav: list[Any]) -> dict[str, str]:
    """What the navigation calls each page that it gives a name, by the page's path."""
    found: dict[str, str] = {}
    for entry in nav:
        for name, value in entry.items() if isinstance(entry, dict) else ():
            found.update(_names(value) if isinstance(value, list) else {value: name})
    return found


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    def mathml(found: re.Match[str]) -> str:
        tex = html.unescape(found.group(3)).strip()
        return convert(tex, display="block" if found.group(2) == "[" else "inline")

    def by_theme(found: re.Match[str]) -> str:
        before, name, after = found.groups()
        dark = posixpath.normpath(posixpath.join(posixpath.dirname(page.file.src_uri), f"{name}-dark.svg"))
        if files.get_file_from_path(dark) is None:
            return found.group(0)
        return f'<img {before}src="{name}.svg#only-light"{after}><img {before}src="{name}-dark.svg#only-dark"{after}>'

    return PICTURE.sub(by_theme, MATH.sub(mathml, content))


def _outside_fences(markdown: str, change: Callable[[str], str]) -> str:
    """`change` applied to all of a page but its fenced blocks."""
    parts, at = [], 0
    for fence in FENCED.finditer(markdown):
        parts += [change(markdown[at : fence.start()]), fence.group(0)]
        at = fence.end()
    return "".join([*parts, change(markdown[at:])])


def _from_root(markdown: str) -> str:
    """A page of the root as one of docs/: links into docs/ become links beside it, others lead out of docs/."""

    def moved(found: re.Match[str]) -> str:
        return f"]({posixpath.relpath(found.group(1), 'docs')}{found.group(2) or ''})"

    return _outside_fences(markdown, lambda text: LINK.sub(moved, text))


def _repository_path(link: str, page: str) -> str | None:
    """The path from the root of a linked file or folder that is no page of the site; None for pages and pictures."""
    path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), link))
    if path in ROOT_PAGES.values() or path.startswith("..") or not (ROOT / path).exists():
        return None
    inside = path.startswith("docs/")
    if inside and not (Path(path).suffix in EXCLUDED or path.startswith("docs/drawings") or (ROOT / path).is_dir()):
        return None
    if inside and (ROOT / path / "README.md").exists():
        return None
    return path


def _linked_files(markdown: str, page: str) -> set[str]:
    return {
        target
        for found in LINK.finditer(FENCED.sub("", markdown))
        if (target := _repository_path(found.group(1), page)) is not None
    }


def _page_of(path: str) -> str:
    return f"source/{path}.md"


def _source_page(path: str) -> str:
    """The text of a file, or what is in a folder, module by module, by the first sentence of each."""
    head = f"---\nsearch: {{exclude: true}}\nhide: [toc]\n---\n\n# {path}\n\n"
    source = ROOT / path
    if source.is_dir():
        rows = [f"| `{one.name}` | {_first_line(one)} |" for one in sorted(source.iterdir()) if _is_shown(one)]
        return head + "\n".join(["| file | what is in it |", "|---|---|", *rows, ""])
    text = source.read_text(encoding="utf-8")
    return f"{head}~~~~~{LANGUAGES.get(source.suffix, 'text')}\n{text}\n~~~~~\n"


def _is_shown(path: Path) -> bool:
    return not path.name.startswith((".", "__pycache__")) and (path.is_dir() or path.stat().st_size < 1_000_000)


def _first_line(path: Path) -> str:
    file = path / "__init__.py" if path.is_dir() else path
    if file.suffix != ".py" or not file.exists():
        return ""
    said = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return " ".join(said.split("\n\n")[0].split()).replace("|", "\\|").replace("<", "&lt;")
