"""Whether a built site stands on its own: its links lead somewhere, and no page loads from elsewhere.

python scripts/check_site.py out/site
"""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from _command_line import make_parser


class Page(HTMLParser):
    """The links of a page, what it loads, and its anchors."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if given.get("id"):
            self.anchors.add(str(given["id"]))
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))
        loads = given.get("src") if tag != "link" else given.get("href")
        if loads and (tag != "link" or given.get("rel") in ("stylesheet", "preload", "icon")):
            self.loaded.append(str(loads))


def faults(site: Path) -> list[str]:
    """What is wrong, a sentence each."""
    pages = {}
    for path in sorted(each for each in site.rglob("*.html") if "_static" not in each.parts):
        pages[path.resolve()] = page = Page()
        page.feed(path.read_text("utf-8"))
    found = []
    for path, page in pages.items():
        here = path.relative_to(site.resolve())
        for link in page.links + page.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    found.append(f"{here} loads {link} from elsewhere")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.exists():
                found.append(f"{here} links to {link}, which is not there")
            elif parts.fragment and target in pages and parts.fragment not in pages[target].anchors:
                found.append(f"{here} links to {link}, where there is no such place")
    return found


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("site", type=Path, help="the folder of a built site")
    site = parser.parse_args().site
    if not (site / "index.html").exists():
        raise SystemExit(f"{site} has no index.html; build the site first")
    found = faults(site)
    if found:
        raise SystemExit("\n".join(found))
    print(f"{site}: all links lead somewhere, and nothing is loaded from elsewhere")


if __name__ == "__main__":
    main()
