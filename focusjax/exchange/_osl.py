"""A camera shader for Cycles (Blender 4.5 and later) with all that focusjax's ideal lenses do.

Blender gives it the place in the frame, 0 to 1 to the right and up, and two random numbers, and takes the
origin and direction of a ray in the camera's axes (right, up, ahead) in metres. The point in focus of a film
point with the tangents (x, y) is (x, y, 1) / w, w = n . (x, y, 1); the ray goes there from a point Q of the
opening, along (x, y, 1) - w Q, which also holds where nothing ahead is in focus. Source: Blender's manual,
"Custom Camera".
"""

import math

import numpy as np
from jaxtyping import Float

from focusjax.exchange._files import number
from focusjax.exchange._record import Frame, Record

_CELLS = 48
"""Most cells across for the table of a focal surface; it is bilinear in each."""

PARAMETERS = (
    *("left", "right", "bottom", "top"),
    *("aperture_radius", "focal_length"),
    *("plane_x", "plane_y", "plane_z"),
)
"""Of the shader, in metres, tangents and 1/m; those of `parameters`."""

_OPENING = """
/* A point of the opening for two random numbers: right and up, in aperture radii. */
vector opening(float u, float v)
{{
    float radius = sqrt(v);
    float blades = {blades};
    if (blades < 3) {{
        return vector(radius * cos(M_2PI * u) / {squeeze}, radius * sin(M_2PI * u), 0);
    }}
    float roundness = {roundness};
    float half_side = M_PI / blades;
    float straight = (1 - roundness) * cos(half_side) * cos(half_side);
    float side = floor(u * blades);
    float share = 2 * (u * blades - side) - 1;
    float target = share * (straight * tan(half_side) + roundness * half_side);
    float t = share * half_side;
    for (int step = 0; step < 6; step += 1) {{
        float slope = straight / (cos(t) * cos(t)) + roundness;
        t = clamp(t - (straight * tan(t) + roundness * t - target) / slope, -half_side, half_side);
    }}
    radius *= sqrt(straight / (cos(t) * cos(t)) + roundness);
    float angle = {rotation} + (2 * side + 1) * half_side + t;
    return vector(radius * cos(angle) / {squeeze}, -radius * sin(angle), 0);
}}
"""

_PLANE = """
    float focus = plane_x * x + plane_y * y + plane_z;
    float scale = 1;
"""

_SURFACE = """
    int columns = {columns};
    int rows = {rows};
    float focus_at[{count}] = {{{focus}}};
    float scale_at[{count}] = {{{scale}}};
    float across = clamp(raster[0], 0, 1) * (columns - 1);
    float down = (1 - clamp(raster[1], 0, 1)) * (rows - 1);
    int column = min((int)floor(across), columns - 2);
    int row = min((int)floor(down), rows - 2);
    int first = row * columns + column;
    float s = across - column;
    float t = down - row;
    float scale = mix(mix(scale_at[first], scale_at[first + 1], s),
                      mix(scale_at[first + columns], scale_at[first + columns + 1], s), t);
    float product = mix(mix(focus_at[first], focus_at[first + 1], s),
                        mix(focus_at[first + columns], focus_at[first + columns + 1], s), t);
    float focus = scale > 0 ? product / scale : 0;
"""

_SHADER = """/* The lens of a focusjax camera: lengths in metres, and the tangents of the frame's borders. */
{opening}
shader focusjax_camera(
{declared}
    output point position = point(0),
    output vector direction = vector(0, 0, 1),
    output color throughput = color(1))
{{
    point raster = camera_shader_raster_position();
    point pair = camera_shader_random_sample();
    float x = mix(left, right, raster[0]);
    float y = mix(bottom, top, raster[1]);
{focus}
    /* The opening turns with the lens: by the smallest rotation that takes the view axis to the lens's. */
    float axis_x = focal_length * plane_x;
    float axis_y = focal_length * plane_y;
    float axis_z = sqrt(max(1 - axis_x * axis_x - axis_y * axis_y, 0));
    vector p = opening(pair[0], pair[1]);
    float lean = axis_x * p[0] + axis_y * p[1];
    float turn = lean / (1 + axis_z);
    vector q = scale * aperture_radius * vector(p[0] - axis_x * turn, p[1] - axis_y * turn, -lean);
    position = point(q[0], q[1], q[2]);
    direction = normalize(vector(x, y, 1) - focus * q);
}}
"""


def shader_text(record: Record) -> str:
    """The shader of a record, its parameters set to those of the first frame."""
    opening = record.opening
    shape = _OPENING.format(
        blades=opening.blades,
        roundness=number(opening.roundness),
        rotation=number(opening.rotation),
        squeeze=number(opening.squeeze),
    )
    values = parameters(record, record.frames[0])
    declared = "\n".join(f"    float {key} = {number(values[key])}," for key in PARAMETERS)
    focus = _PLANE if record.surface is None else _surface(*record.surface)
    return _SHADER.format(opening=shape, declared=declared, focus=focus)


def parameters(record: Record, frame: Frame) -> dict[str, float]:
    """The shader's parameters in a frame."""
    half = frame.sensor_width / 2.0
    half_height = half * record.height / record.width
    length = frame.focal_length
    values = (
        (frame.shift - half) / length,
        (frame.shift + half) / length,
        (frame.rise - half_height) / length,
        (frame.rise + half_height) / length,
        frame.aperture_radius,
        length,
        *frame.plane,
    )
    return dict(zip(PARAMETERS, values, strict=True))


def _surface(focus: Float[np.ndarray, "rows columns"], scale: Float[np.ndarray, "rows columns"]) -> str:
    """The shader's lines for a focal surface, of which at most so many cells are kept."""
    rows, columns = (np.unique(_kept(side)) for side in focus.shape)
    at = np.ix_(rows, columns)
    kept_scale = scale[at]
    return _SURFACE.format(
        columns=len(columns),
        rows=len(rows),
        count=kept_scale.size,
        focus=", ".join(number(round(float(value), 9)) for value in (focus[at] * kept_scale).ravel()),
        scale=", ".join(number(round(float(value), 9)) for value in kept_scale.ravel()),
    )


def _kept(side: int) -> np.ndarray:
    """Evenly spaced corners along a side of so many."""
    cells = side - 1
    steps = next(n for n in range(min(cells, _CELLS), 0, -1) if cells % n == 0)
    return np.arange(steps + 1) * (cells // steps)


def needs_shader(record: Record) -> bool:
    """Whether a plain camera of Blender cannot say it: tilt, a focal surface, round blades, or many."""
    opening = record.opening
    odd = opening.roundness > 0 or opening.blades > 16
    return odd or record.surface is not None or any(frame.tilted for frame in record.frames)


def blade_rotation(record: Record) -> float:
    """Blender's `aperture_rotation`, which turns a side's middle counter-clockwise from the right."""
    opening = record.opening
    if not opening.blades:
        return 0.0
    turn = -opening.rotation - math.pi / opening.blades
    return math.remainder(turn, 2.0 * math.pi)
