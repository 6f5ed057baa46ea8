"""The picture of the rooms, from the import statements of the package: an SVG without other files.

    python docs/_ext/rooms.py

writes `docs/explanation/rooms.svg`; the site's build writes it anew.
"""

import ast
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
PACKAGE = DOCS.parent / "focusjax"
WIDTH, HEIGHT, ACROSS, DOWN = 104, 30, 122, 74


def imports() -> dict[str, set[str]]:
    """For every room the rooms that it imports."""
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    found: dict[str, set[str]] = {room: set() for room in rooms}
    for room in rooms:
        for path in (PACKAGE / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                module = getattr(node, "module", None) if isinstance(node, ast.ImportFrom) else None
                if module and module.startswith("focusjax."):
                    found[room] |= {module.split(".")[1]} & rooms - {room}
    return found


def reachable(room: str, edges: dict[str, set[str]]) -> set[str]:
    """All rooms below one."""
    below = set(edges[room])
    for each in edges[room]:
        below |= reachable(each, edges)
    return below


def reduced(edges: dict[str, set[str]]) -> dict[str, set[str]]:
    """Without arrows that follow from others."""
    return {
        room: {each for each in below if not any(each in reachable(other, edges) for other in below - {each})}
        for room, below in edges.items()
    }


def level(room: str, edges: dict[str, set[str]]) -> int:
    """0 for rooms that import none, else one more than the highest below."""
    return 1 + max((level(each, edges) for each in edges[room]), default=-1)


def drawing() -> str:
    """The SVG: rows by level, the command line's side on top."""
    edges = imports()
    arrows, rows = reduced(edges), {}
    for room in sorted(edges):
        rows.setdefault(level(room, edges), []).append(room)
    top, most = max(rows), max(len(row) for row in rows.values())
    places: dict[str, tuple[float, float]] = {}
    for height in range(top + 1):
        # Each above the mean of what it imports, in that order, so that few arrows cross.
        def mean(room: str) -> float:
            below = [places[each][0] for each in arrows[room]]
            return sum(sorted(below)) / len(below) if below else 0.0

        row = sorted(rows[height], key=lambda room: (mean(room), room))
        start = (most - len(row)) / 2
        for number, room in enumerate(row):
            places[room] = ((start + number + 0.5) * ACROSS, (top - height + 0.5) * DOWN)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {most * ACROSS} {(top + 1) * DOWN}"'
        ' font-family="sans-serif" font-size="13">',
        '<rect width="100%" height="100%" fill="white"/>',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"'
        ' orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="#7a8794"/></marker></defs>',
    ]
    for room, below in sorted(arrows.items()):
        x, y = places[room]
        for each in sorted(below):
            u, v = places[each]
            bend = f"C{x:.0f} {y + DOWN / 2:.0f} {u:.0f} {v - DOWN / 2:.0f} {u:.0f} {v - HEIGHT / 2:.0f}"
            parts.append(
                f'<path d="M{x:.0f} {y + HEIGHT / 2:.0f} {bend}" fill="none" stroke="#7a8794"'
                ' marker-end="url(#tip)"/>'
            )
    for room, (x, y) in places.items():
        parts.append(
            f'<rect x="{x - WIDTH / 2:.0f}" y="{y - HEIGHT / 2:.0f}" width="{WIDTH}" height="{HEIGHT}" rx="5"'
            ' fill="#e8f0f7" stroke="#34577a"/>'
        )
        parts.append(f'<text x="{x:.0f}" y="{y + 4.5:.1f}" text-anchor="middle" fill="#16293c">{room}</text>')
    return "\n".join([*parts, "</svg>", ""])


def write_drawing() -> None:
    """Write the picture, unless it is as it was."""
    path, text = DOCS / "explanation" / "rooms.svg", drawing()
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Have the picture drawn."""
    app.connect("builder-inited", lambda _: write_drawing())
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    write_drawing()
