"""What the signs in the pictures mean."""

from nicegui import ui

from tactile_core.figures.style import INK, MUTED, PINK, RAY, SHAPE, YELLOW

SIGNS = {
    "the object, shown at the end": (
        f'<rect x="4" y="2" width="22" height="14" rx="5" fill="{SHAPE}" stroke="{INK}" '
        'stroke-width="1.5" stroke-dasharray="4 2"/>'
    ),
    "its reconstruction from what was felt": (
        f'<rect x="4" y="2" width="22" height="14" rx="5" fill="{PINK}" fill-opacity=".7" '
        f'stroke="{PINK}" stroke-width="1.5"/>'
    ),
    "uncertain: the larger the dot, the more": "".join(
        f'<rect x="{x - side / 2}" y="{y - side / 2}" width="{side}" height="{side}" '
        f'fill="{INK}" fill-opacity=".5"/>'
        for x, side in ((6, 1.5), (12, 2.5), (18, 3.5), (24, 4.5))
        for y in (5, 13)
    ),
    "a ray, from its start to its touch": (
        f'<path d="M4 14L26 4" stroke="{RAY}" stroke-width="2"/>'
        f'<circle cx="4" cy="14" r="3" fill="{RAY}"/>'
    ),
    "a touch": (
        f'<circle cx="15" cy="9" r="5.5" fill="{YELLOW}" stroke="{INK}" stroke-width="1.5"/>'
    ),
    "a miss: the ray met nothing": (
        f'<path d="M3 9H21" stroke="{MUTED}" stroke-width="2" stroke-dasharray="4 3"/>'
        f'<path d="M22 5l7 8m0-8l-7 8" stroke="{MUTED}" stroke-width="2"/>'
    ),
}
HELP = (
    "<b>Mouse</b>: press where the ray starts and drag to where it should go, or click both. "
    "<b>Keys</b>: <kbd>←</kbd> <kbd>→</kbd> turn the ray, <kbd>↑</kbd> <kbd>↓</kbd> swing it, with "
    "<kbd>Shift</kbd> faster, <kbd>Enter</kbd> casts, <kbd>Esc</kbd> drops it, <kbd>N</kbd> is a "
    "new game."
)


def legend() -> None:
    """A line for each sign."""
    rows = "".join(
        f'<svg viewBox="0 0 30 18" aria-hidden="true">{sign}</svg><span>{words}</span>'
        for words, sign in SIGNS.items()
    )
    ui.html(rows, sanitize=False).classes("key")
    ui.html(HELP, sanitize=False).classes("help")
