"""Whether the solver finds the best lens, and whether its diagnosis is true.

Random problems of 3 to 12 wishes of all kinds are solved for several sets of free parameters. scipy's
bounded least squares solves the same problems from many random starts, on residuals that are written here in
float64 and share no code with focusjax. The study counts the problems in which focusjax's cost is more than
1 % (and 1e-9 px^2 a wish) above scipy's best, and those in which it is as much below.

With `--shots` the problems are shots of 1 to 8 frames, whose wishes move: focus, and focus with f-number, of
all frames together, with what smoothness over time costs.

With `--diagnosis` each statement about conflicting problems is tested by scipy on the altered problem:
without a wish another gains so many pixels; a wish is out of reach even alone; a limit stands in the way.

    python scripts/solver_study.py --problems 300 --starts 100
    python scripts/solver_study.py --shots --problems 100 --starts 30
    python scripts/solver_study.py --diagnosis --problems 100
"""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from _command_line import make_parser

from focusjax.focus import AT_LEAST, AT_MOST, EQUAL, SAME, ImagePoints, diagnose, solve, solve_frames
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens

LENGTH, WIDTH, HEIGHT, SENSOR = 0.05, 640, 480, 0.036
SETS = {
    "focus": ("focus",),
    "focus, f-number": ("focus", "f_number"),
    "focus, f-number, focal length": ("focus", "f_number", "focal_length"),
    "focus, f-number, tilt, swing": ("focus", "f_number", "tilt", "swing"),
    "all": ("focus", "f_number", "tilt", "swing", "focal_length"),
}
# Focus disparity in 1/m, f-number, tilt and swing in rad, focal length in m.
NAMES = ("focus", "f_number", "tilt", "swing", "focal_length")
LOWER = np.array([0.0, 1.0, -np.pi / 4, -np.pi / 4, 0.03])
UPPER = np.array([2.0, 22.0, np.pi / 4, np.pi / 4, 0.1])
FIRST = np.array([0.25, 4.0, 0.0, 0.0, LENGTH])


class Problem:
    """Wishes as arrays: what focusjax is given, and residuals of our own."""

    def __init__(self, seed, conflicting=False):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(3, 13))
        self.xy = rng.uniform([0, 0], [WIDTH, HEIGHT], (count, 2))
        self.disparity = rng.uniform(0.0, 1.5, count)
        kinds = [EQUAL] if conflicting else [EQUAL, EQUAL, AT_MOST, AT_LEAST, SAME]
        self.relation = rng.choice(kinds, count)
        sharp = (rng.random(count) < 0.4) & (self.relation == EQUAL)
        self.signed = sharp | ((rng.random(count) < 0.4) & (self.relation == EQUAL))
        size = rng.exponential(12.0, count)
        flip = self.signed & (rng.random(count) < 0.5)
        self.target = np.where(sharp | (self.relation == SAME), 0.0, np.where(flip, -size, size))
        self.weight = np.exp(rng.normal(size=count))
        other = np.roll(np.arange(count), 1)
        self.other_xy, self.other_disparity = self.xy[other], self.disparity[other]

    def points(self):
        count = len(self.target)
        return ImagePoints(
            xy=jnp.asarray(self.xy),
            disparity=jnp.asarray(self.disparity),
            target=jnp.asarray(self.target),
            signed=jnp.asarray(self.signed),
            weight=jnp.asarray(self.weight),
            tolerance=jnp.ones(count),
            wish=jnp.arange(count),
            names=tuple(f"wish {index + 1}" for index in range(count)),
            relation=jnp.asarray(self.relation),
            reference=jnp.asarray(np.concatenate([self.other_xy, self.other_disparity[:, None]], axis=1)),
        )

    def errors(self, value):
        """Errors in pixels: blur = 2 f E (n . (x, y, 1) - w) of a lens focused on the plane n . P = 1."""
        focus, number, tilt, swing, length = value
        pixels = length * WIDTH / SENSOR

        def blur(xy, disparity):
            # Directions do not change with the focal length.
            across = (xy - [WIDTH / 2, HEIGHT / 2]) * [1, -1] * SENSOR / WIDTH / LENGTH
            plane = focus + (np.sin(swing) * across[:, 0] - np.sin(tilt) * across[:, 1]) / length
            return pixels * length / number * (plane - disparity)

        own, other = blur(self.xy, self.disparity), blur(self.other_xy, self.other_disparity)
        same = self.relation == SAME
        # The same blur on either side is |b| = |c|, and on the same side b = c.
        led = np.where(self.signed, own, np.abs(own))
        error = led - np.where(same, np.where(self.signed, other, np.abs(other)), self.target)
        error = np.where(self.relation == AT_MOST, np.maximum(error, 0.0), error)
        return np.where(self.relation == AT_LEAST, np.minimum(error, 0.0), error)

    def cost(self, value):
        return 0.5 * np.sum(self.weight * self.errors(value) ** 2)

    def by_scipy(self, free, starts, seed, lower=LOWER, upper=UPPER):
        """The best of many starts: its cost and value."""
        which = [NAMES.index(name) for name in free]
        rng = np.random.default_rng(seed)

        def full(part):
            value = FIRST.copy()
            value[which] = part
            return value

        def residuals(part):
            return np.sqrt(self.weight) * self.errors(full(part))

        best, at = np.inf, FIRST
        for start in range(starts):
            first = rng.uniform(lower, upper) if start else np.clip(FIRST, lower, upper)
            first[1] = np.exp(rng.uniform(*np.log([lower[1], upper[1]]))) if start else first[1]
            found = scipy.optimize.least_squares(
                residuals, first[which], bounds=(lower[which], upper[which]), x_scale=(upper - lower)[which]
            )
            if found.cost < best:
                best, at = found.cost, full(found.x)
        return best, at


class Shot:
    """Wishes that move over a few frames, and the cost of all frames with that of changes between them."""

    smoothness, steadiness = 100.0, 1.0

    def __init__(self, seed):
        rng = np.random.default_rng(20_000 + seed)
        count = int(rng.integers(1, 9))
        first = Problem(seed)
        shift = rng.normal(size=first.xy.shape) * 0.02 * WIDTH
        nearer = 0.1 * rng.normal(size=first.disparity.shape)
        self.frames = []
        for time in range(count):
            frame = Problem(seed)
            frame.xy = np.clip(first.xy + time * shift, 0.0, [WIDTH, HEIGHT])
            frame.disparity = np.clip(first.disparity + time * nearer, 0.0, 1.9)
            # Wishes come and go; the first is always there.
            gone = rng.random(len(first.weight)) < 0.15
            frame.weight = first.weight * np.where(gone & (np.arange(len(gone)) > 0), 0.0, 1.0)
            other = np.roll(np.arange(len(first.weight)), 1)
            frame.other_xy, frame.other_disparity = frame.xy[other], frame.disparity[other]
            self.frames.append(frame)

    def residuals(self, focus, radius):
        """Of wishes, and of changes in pixels: of the starting lens's blur, and of one of 10 px."""
        start = LENGTH / (2 * FIRST[1])
        rows = []
        for frame, disparity, opening in zip(self.frames, focus, radius, strict=True):
            value = np.array([disparity, LENGTH / (2 * opening), 0.0, 0.0, LENGTH])
            rows.append(np.sqrt(frame.weight) * frame.errors(value))
        for changes in (2 * LENGTH * WIDTH / SENSOR * start * focus, 10.0 / start * radius):
            rows.append(np.sqrt(self.smoothness) * np.diff(changes, 2))
            rows.append(np.sqrt(self.steadiness) * np.diff(changes))
        return np.concatenate(rows)

    def cost(self, focus, radius):
        return 0.5 * np.sum(self.residuals(focus, radius) ** 2)

    def by_scipy(self, free, starts, seed):
        """The least cost from many starts: every other one has frames that are alike."""
        rng, count = np.random.default_rng(seed), len(self.frames)
        lower = np.array([LOWER[0], LENGTH / (2 * UPPER[1])])
        upper = np.array([UPPER[0], LENGTH / (2 * LOWER[1])])
        given = np.array([FIRST[0], LENGTH / (2 * FIRST[1])])
        size = len(free)

        def split(part):
            value = part.reshape(count, size)
            return value[:, 0], value[:, 1] if size > 1 else np.full(count, given[1])

        best = np.inf
        for start in range(starts):
            shape = (1, 2) if start % 2 else (count, 2)
            first = np.broadcast_to(rng.uniform(lower, upper, shape) if start else given, (count, 2))
            found = scipy.optimize.least_squares(
                lambda part: self.residuals(*split(part)),
                first[:, :size].ravel(),
                bounds=(np.tile(lower[:size], count), np.tile(upper[:size], count)),
                x_scale=np.tile((upper - lower)[:size], count),
            )
            best = min(best, found.cost)
        return best


def lens_values(solution, free):
    """The parameters of a solution as this script has them."""
    lens, length = solution.lens, float(solution.camera.focal_length)
    plane = np.asarray(lens.plane) if hasattr(lens, "plane") else np.array([0, 0, lens.focus_disparity])
    value = np.array(
        [
            plane[2],
            length / (2 * float(lens.aperture_radius)),
            -np.arcsin(plane[1] * length),
            np.arcsin(plane[0] * length),
            length,
        ]
    )
    # Bounds hold to rounding, beyond which this script would divide by another f-number.
    return np.where(np.isin(NAMES, free), value, FIRST)


def setup():
    camera = make_camera(jnp.eye(4), width=WIDTH, height=HEIGHT, focal_length=LENGTH, sensor_width=SENSOR)
    lens = thin_lens(focus_distance=4.0, f_number=4.0, focal_length=LENGTH)
    return camera, lens


def options(free):
    return {
        "free": free,
        "min_focus_distance": 0.5,
        **({"f_number_range": (1.0, 22.0)} if "f_number" in free else {}),
        **({"focal_length_range": (0.03, 0.1)} if "focal_length" in free else {}),
    }


def study_costs(problems, starts, chosen):
    """Ours against scipy's best, for each set of free parameters, and for a shot of one frame."""
    camera, lens = setup()
    for name, free in SETS.items():
        if chosen and chosen not in name:
            continue
        worse, better, apart = [], [], []
        for seed in range(problems):
            problem = Problem(seed)
            solution = solve(problem.points(), camera, lens, throw=False, **options(free))
            value = lens_values(solution, free)
            ours, (theirs, _) = problem.cost(value), problem.by_scipy(free, starts, seed)
            slight = 1e-9 * problem.weight.sum()
            if abs(ours - float(solution.cost)) > 1e-6 * (ours + slight):
                print(
                    f"  {name}, problem {seed}: cost {float(solution.cost):.9g} is {ours:.9g} by this script"
                )
            if ours > 1.01 * theirs + slight:
                worse.append(f"{seed}: {ours:.4g} instead of {theirs:.4g}")
            if theirs > 1.01 * ours + slight:
                better.append(seed)
            shot = solve_frames([problem.points()], camera, lens, throw=False, **options(free))
            missed = np.asarray(shot.error)[0, : len(problem.weight)]
            shot_cost = float(np.sum(problem.weight * missed**2) / 2)
            if abs(shot_cost - ours) > 1e-5 * (ours + slight):
                apart.append(f"{seed}: {shot_cost:.6g} instead of {ours:.6g}")
        print(f"{name}: {problems} problems; worse than scipy from {starts} starts in {len(worse)} {worse},")
        print(f"  better in {len(better)}; a shot of one frame differs in {len(apart)} {apart}", flush=True)


def study_shots(problems, starts, chosen):
    """Shots of 1 to 8 frames: ours against scipy's best."""
    camera, lens = setup()
    for name in ("focus", "focus, f-number"):
        if chosen and chosen not in name:
            continue
        free, worse, better = SETS[name], [], 0
        for seed in range(problems):
            shot = Shot(seed)
            solution = solve_frames(
                [frame.points() for frame in shot.frames],
                camera,
                lens,
                throw=False,
                smoothness=shot.smoothness,
                steadiness=shot.steadiness,
                **options(free),
            )
            ours = shot.cost(
                np.asarray(solution.lens.focus_disparity), np.asarray(solution.lens.aperture_radius)
            )
            theirs = shot.by_scipy(free, starts, seed)
            slight = 1e-9 * sum(frame.weight.sum() for frame in shot.frames)
            if abs(ours - float(solution.cost)) > 1e-6 * (ours + slight):
                print(f"  {name}, shot {seed}: cost {float(solution.cost):.9g} is {ours:.9g} by this script")
            if ours > 1.01 * theirs + slight:
                worse.append(f"{seed} ({len(shot.frames)} frames): {ours:.4g} instead of {theirs:.4g}")
            better += theirs > 1.01 * ours + slight
        print(f"{name}: {problems} shots; worse than scipy from {starts} starts in {len(worse)} {worse},")
        print(f"  better in {better}", flush=True)


def study_diagnosis(problems, starts):
    """Each statement about conflicting problems against scipy on the altered problem."""
    camera, lens = setup()
    free = ("focus", "f_number")
    said = {"gain": 0, "out of reach": 0, "limit": 0}
    false = {kind: [] for kind in said}
    for seed in range(problems):
        problem = Problem(10_000 + seed, conflicting=True)
        solution = solve(problem.points(), camera, lens, **options(free))
        found = diagnose(solution)
        names = solution.points.names
        error = np.abs(problem.errors(lens_values(solution, free)))
        weight = problem.weight

        def altered(weights, problem=problem, seed=seed):
            problem.weight = weights
            _, value = problem.by_scipy(free, starts, seed)
            return np.abs(problem.errors(value))

        for conflict in found.conflicts:
            first, second = names.index(conflict.first), names.index(conflict.second)
            for gains, kept, dropped in (
                (conflict.first_gains, first, second),
                (conflict.second_gains, second, first),
            ):
                said["gain"] += 1
                without = altered(np.where(np.arange(len(weight)) == dropped, 0.0, weight))
                if abs(error[kept] - without[kept] - gains) > 0.05 * abs(gains) + 0.01:
                    false["gain"].append((seed, round(gains, 3), round(error[kept] - without[kept], 3)))
        for wish in found.unreachable:
            said["out of reach"] += 1
            alone = altered(np.where(np.arange(len(weight)) == names.index(wish.name), weight, 0.0))
            best = alone[names.index(wish.name)]
            if abs(best - wish.best) > 0.05 * wish.best:
                false["out of reach"].append((seed, wish.name, wish.best, best))
        problem.weight = weight
        wider = {"max_f_number": (1, 1.0), "min_f_number": (1, -0.1), "min_focus_distance": (0, 0.2)}
        for bound in found.active_bounds:
            if bound not in wider:
                continue
            said["limit"] += 1
            which, by = wider[bound]
            lower, upper = LOWER.copy(), UPPER.copy()
            (upper if by > 0 else lower)[which] += by
            cost, _ = problem.by_scipy(free, starts, seed, lower, upper)
            if not cost < problem.cost(lens_values(solution, free)):
                false["limit"].append((seed, bound))
    for kind, count in said.items():
        print(f"{kind}: {count} statements, {len(false[kind])} false {false[kind]}", flush=True)


def main():
    parser = make_parser(__doc__)
    parser.add_argument("--problems", type=int, default=60)
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--set", default="", help="only sets of free parameters whose name has this")
    parser.add_argument("--shots", action="store_true")
    parser.add_argument("--diagnosis", action="store_true")
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if chosen.diagnosis:
        study_diagnosis(chosen.problems, chosen.starts)
    elif chosen.shots:
        study_shots(chosen.problems, chosen.starts, chosen.set)
    else:
        study_costs(chosen.problems, chosen.starts, chosen.set)


if __name__ == "__main__":
    main()
