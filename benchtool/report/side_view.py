"""A vehicle over its surface seen from the side, as one SVG element whose parts a page moves.

Lengths in the drawing are metres, x to the right and down the page against height. What moves has
a class: `world` (everything that stands, shifted against the vehicle), `moving` (plates that come
and go), `vehicle` (shifted, and rotated about its centre) and in it one `rotor` each: its `own`
thrust without a surface with a `tip`, and on top what the surface has `added`, enlarged. The
element says how long an arrow is. The drawing shows everything at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import escape

from benchtool.report.palette import BLUE, GREEN, GREY, VERMILION

ARROW_RADII = 3.0
"""Length of the arrow of a rotor at hover thrust, in rotor radii; a choice."""

ADDED_TIMES = 5.0
"""How many times enlarged is what a surface adds: at z/R = 2 it is a hundredth of the thrust."""

SLANT = (0.25, 0.1)
"""How far a rotor to the left of the vehicle's middle is drawn to the right and up, per metre: from
straight abeam one rotor would hide the other. A choice."""

BESIDE_RADII = 0.22
"""How far the arrow of a second rotor on one disc stands beside the first's, in rotor radii."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """Draw something to fly over, with corners (along, up) in m."""

    outline_m: tuple[tuple[float, float], ...]
    name: str = ""
    moves: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Hold what stands in a side view.

    Attributes:
        rotors_m: place of each rotor in the vehicle, forward and left, in m.
        hinged: whether the vehicle turns on a hinge that stands on the ground.
        width_m, top_m, bottom_m: what is shown: half of the width on each side of the vehicle.
    """

    title: str
    rotors_m: tuple[tuple[float, float], ...]
    radius_m: float
    surfaces: tuple[Surface, ...] = ()
    hinged: bool = False
    width_m: float = 1.0
    top_m: float = 0.5
    bottom_m: float = -0.5
    ruler_m: tuple[float, float] | None = None

    @property
    def arrow_m(self) -> float:
        """Length of an arrow for the thrust of hover."""
        return ARROW_RADII * self.radius_m


def side_view_svg(scene: Scene) -> str:
    """Return the drawing; colours of lines and words are the page's own."""
    left, height = -0.5 * scene.width_m, scene.top_m - scene.bottom_m
    moving = [_surface(scene, each) for each in scene.surfaces if each.moves]
    world = [_surface(scene, each) for each in scene.surfaces if not each.moves]
    world += [f'<g class="moving">{text}</g>' for text in moving]
    if scene.ruler_m is not None:
        world += _ruler(scene, *scene.ruler_m)
    stand = [_stand(scene)] if scene.hinged else []
    return "".join(
        (
            f'<svg class="side-view" role="img" aria-label="{escape(scene.title)}" '
            f'viewBox="{left:.4g} {-scene.top_m:.4g} {scene.width_m:.4g} {height:.4g}" '
            f'data-arrow="{scene.arrow_m:.4g}" data-tip="{_tip_m(scene):.4g}" '
            f'data-times="{ADDED_TIMES:g}">',
            '<g class="world">',
            *world,
            "</g>",
            *stand,
            '<g class="vehicle">',
            *_vehicle(scene),
            "</g></svg>",
        )
    )


def _surface(scene: Scene, surface: Surface) -> str:
    corners = " ".join(f"{x:.4g},{-z:.4g}" for x, z in surface.outline_m)
    shape = (
        f'<polygon points="{corners}" fill="{GREEN}" fill-opacity="0.35" stroke="{GREEN}" '
        f'stroke-width="1.5" vector-effect="non-scaling-stroke"/>'
    )
    if not surface.name:
        return shape
    along = [x for x, _ in surface.outline_m]
    top = max(z for _, z in surface.outline_m)
    middle = 0.5 * (min(along) + max(along))
    return shape + _words(scene, middle, top - 0.055 * scene.width_m, surface.name)


def _words(scene: Scene, x_m: float, z_m: float, text: str) -> str:
    size = 0.04 * scene.width_m
    return (
        f'<text x="{x_m:.4g}" y="{-z_m:.4g}" font-size="{size:.3g}" text-anchor="middle" '
        f'fill="currentColor">{escape(text)}</text>'
    )


def _ruler(scene: Scene, begin_m: float, end_m: float) -> list[str]:
    foot = scene.bottom_m + 0.06 * scene.width_m
    marks = []
    for half in range(round(2.0 * begin_m), round(2.0 * end_m) + 1):
        x = 0.5 * half
        long = 0.03 if half % 2 == 0 else 0.015
        marks.append(_line((x, foot), (x, foot + long * scene.width_m), GREY, 1.0))
        if half % 2 == 0:
            marks.append(_words(scene, x, scene.bottom_m + 0.015 * scene.width_m, f"{x:.0f} m"))
    return marks


def _stand(scene: Scene) -> str:
    """Draw the hinge: a triangle from the vehicle's centre down to the edge."""
    wide, deep = 0.05 * scene.width_m, scene.bottom_m
    return (
        f'<polygon points="0,0 {wide:.4g},{-deep:.4g} {-wide:.4g},{-deep:.4g}" fill="{GREY}" '
        f'fill-opacity="0.3" stroke="{GREY}" stroke-width="1" vector-effect="non-scaling-stroke"/>'
    )


def _vehicle(scene: Scene) -> list[str]:
    places = [_projected(x, y) for x, y in scene.rotors_m]
    body = 0.18 * max(max(abs(x) for x, _ in scene.rotors_m), scene.radius_m)
    parts = [_line((0.0, 0.0), place, "currentColor", 3.0) for place in dict.fromkeys(places)]
    parts.append(
        f'<rect x="{-body:.4g}" y="{-0.35 * body:.4g}" width="{2.0 * body:.4g}" '
        f'height="{0.8 * body:.4g}" rx="{0.2 * body:.4g}" fill="currentColor"/>'
    )
    parts += [_disc(scene, place) for place in dict.fromkeys(places)]
    # The far rotors first, so that near arrows stand before them.
    order = sorted(range(len(places)), key=lambda i: -scene.rotors_m[i][1])
    parts += [_arrow(scene, i, _beside(scene, places, i)) for i in order]
    return parts


def _disc(scene: Scene, place: tuple[float, float]) -> str:
    return (
        f'<ellipse cx="{place[0]:.4g}" cy="{-place[1]:.4g}" rx="{scene.radius_m:.4g}" '
        f'ry="{0.09 * scene.radius_m:.4g}" fill="currentColor" fill-opacity="0.25" '
        f'stroke="currentColor" stroke-width="1" vector-effect="non-scaling-stroke"/>'
    )


def _projected(x_m: float, y_m: float) -> tuple[float, float]:
    return x_m + SLANT[0] * y_m, SLANT[1] * y_m


def _beside(scene: Scene, places: Sequence[tuple[float, float]], rotor: int) -> tuple[float, float]:
    """Return where a rotor's arrow stands: those of one disc stand side by side."""
    same = [i for i, place in enumerate(places) if place == places[rotor]]
    x, z = places[rotor]
    step = same.index(rotor) - 0.5 * (len(same) - 1)
    return x + 2.0 * BESIDE_RADII * scene.radius_m * step, z


def _tip_m(scene: Scene) -> float:
    return 0.35 * scene.radius_m


def _arrow(scene: Scene, rotor: int, foot: tuple[float, float]) -> str:
    shaft, wide = scene.arrow_m - _tip_m(scene), 0.22 * scene.radius_m
    place = f"translate({foot[0]:.4g} {-foot[1]:.4g})"
    return (
        f'<g class="rotor" data-rotor="{rotor}" transform="{place}">'
        f'<line class="added" x1="0" x2="0" y1="{-scene.arrow_m:.4g}" y2="{-scene.arrow_m:.4g}" '
        f'stroke="{VERMILION}" stroke-width="7" vector-effect="non-scaling-stroke"/>'
        f'<line class="own" x1="0" x2="0" y1="0" y2="{-shaft:.4g}" stroke="{BLUE}" '
        f'stroke-width="4" vector-effect="non-scaling-stroke"/>'
        f'<polygon class="tip" points="{-wide:.4g},0 {wide:.4g},0 0,{-_tip_m(scene):.4g}" '
        f'fill="{BLUE}" transform="translate(0 {-shaft:.4g})"/></g>'
    )


def _line(begin: tuple[float, float], end: tuple[float, float], color: str, width_px: float) -> str:
    return (
        f'<line x1="{begin[0]:.4g}" y1="{-begin[1]:.4g}" x2="{end[0]:.4g}" y2="{-end[1]:.4g}" '
        f'stroke="{color}" stroke-width="{width_px:g}" vector-effect="non-scaling-stroke"/>'
    )
