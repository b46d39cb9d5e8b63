"""A furnished room, made by code: many thin edges, small lamps and a sky behind windows, which is where real rooms are noisy.

`python3 make.py interior PASSES` makes it.  It stands in for models of real rooms, which this project may not ship.

The file goes from matrices and meshes to pictures, furniture (lists of meshes, materials and matrices) and the room.  Furniture is built
in frames of its own: x to the right, y up, z towards the viewer, walls at z = 0.  Surfaces are closed (thin boxes), so that only fronts
are seen; leaves and curtains are single sheets with flat normals, through which no light leaks in either renderer.  Lamps are
flat-shaded, because Mitsuba samples them by interpolated normals.  Things stand one or two millimeters deep in what carries them:
surfaces that coincide would look different in each renderer.
"""

import pathlib

import numpy
import OpenEXR

from make import FOLDER, Material, Mesh, Scene, Texture, ball, joined, quad

# Half the width and depth of the room, and its height, in meters.
WIDE, DEEP, HIGH = 2.5, 2.0, 2.8


def at(position=(0, 0, 0), turn=0, size=1, tilt=0, lean=0):
    """Scales, leans (about z), tilts (about x), turns (about y) and moves.  Angles are in degrees."""
    matrix = numpy.eye(4)
    for angle, i, j in ((turn, 2, 0), (tilt, 1, 2), (lean, 0, 1)):
        c, s = numpy.cos(numpy.radians(angle)), numpy.sin(numpy.radians(angle))
        rotation = numpy.eye(4)
        rotation[[i, j], [i, j]], rotation[i, j], rotation[j, i] = c, -s, s
        matrix = matrix @ rotation
    matrix[:3, :3] = matrix[:3, :3] * numpy.broadcast_to(size, 3)
    matrix[:3, 3] = position
    return matrix


def between(a, b, radius):
    """Puts a unit rod (ROD) from `a` to `b`."""
    along = numpy.subtract(b, a).astype(float)
    side = numpy.cross(along, (0, 0, 1) if abs(along[2]) < 0.9 * numpy.linalg.norm(along) else (1, 0, 0))
    other = numpy.cross(side, along)
    side, other = (radius * axis / numpy.linalg.norm(axis) for axis in (side, other))
    return numpy.concatenate([numpy.stack([side, along, other, a], 1), [(0, 0, 0, 1)]])


def faceted(mesh):
    """`mesh` with flat normals, without triangles of no area."""
    corners = mesh.positions[mesh.indices].astype(float)
    normals = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = numpy.linalg.norm(normals, axis=1)
    real = lengths > 1e-6 * lengths.max()
    normals = numpy.repeat(normals[real] / lengths[real, None], 3, 0)
    vertices = numpy.concatenate([corners[real].reshape(-1, 3), normals], 1)
    _, first, indices = numpy.unique(vertices.round(5), axis=0, return_index=True, return_inverse=True)
    return Mesh(vertices[first, :3], vertices[first, 3:], None, None, indices.reshape(-1, 3))


def grid(positions, normals):
    """A mesh of points in rows and columns, without triangles of no area."""
    rows, columns = positions.shape[:2]
    first = (numpy.arange(rows - 1)[:, None] * columns + numpy.arange(columns - 1)).ravel()
    indices = numpy.concatenate([
        numpy.stack([first, first + 1, first + columns + 1], 1),
        numpy.stack([first, first + columns + 1, first + columns], 1),
    ])
    positions, normals = positions.reshape(-1, 3), normals.reshape(-1, 3)
    corners = positions[indices]
    areas = numpy.linalg.norm(numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Mesh(positions, normals, None, None, indices[areas > 1e-9])


def revolved(profile, sides=28):
    """A surface of revolution about y.  `profile`: radius and height, with the outside to the right; sharp where it turns by over 50°."""
    points = numpy.asarray(profile, dtype=float)
    steps = numpy.diff(points, axis=0)
    steps /= numpy.linalg.norm(steps, axis=1, keepdims=True)
    angle = numpy.linspace(0, 2 * numpy.pi, sides + 1)
    around = lambda radius, height: numpy.stack([radius * numpy.sin(angle), height + 0 * angle, radius * numpy.cos(angle)], 1)
    smooth = [steps[i] @ steps[i - 1] > 0.64 and (i > 0 or numpy.allclose(points[0], points[-1])) for i in range(len(steps))]
    smooth.append(smooth[0])
    runs, start = [], 0
    for end in range(1, len(steps) + 1):
        if end < len(steps) and smooth[end]:
            continue
        rings = []
        for i in range(start, end + 1):
            before, after = (i > start or smooth[i]) and steps[i - 1], (i < end or smooth[i]) and steps[i % len(steps)]
            along = before + after
            along = along / numpy.linalg.norm(along)
            rings.append((around(*points[i]), around(along[1], -along[0])))
        runs.append(grid(*(numpy.stack(part) for part in zip(*rings))))
        start = end
    return joined(runs)


def curve(points, steps=4):
    """A smooth line through points (Catmull and Rom)."""
    p = numpy.asarray([points[0], *points, points[-1]], dtype=float)
    t = numpy.linspace(0, 1, steps, endpoint=False)[:, None]
    line = []
    for a, b, c, d in zip(p, p[1:], p[2:], p[3:]):
        line.extend(b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a))))
    return [*line, p[-1]]


def shell(outside, thickness):
    """The closed profile of a vessel or shade: `outside` upwards, and back down within."""
    outside = numpy.asarray(outside, dtype=float)
    steps = numpy.gradient(outside, axis=0)
    inwards = numpy.stack([-steps[:, 1], steps[:, 0]], 1) / numpy.linalg.norm(steps, axis=1, keepdims=True)
    inside = numpy.maximum(outside + thickness * inwards, (0, -1))
    return [*outside, *inside[::-1]]


def rounded(radius, steps=3):
    """The unit cube about the origin with round edges: to be scaled to a part of a sofa."""
    bevel = radius * numpy.tan(numpy.linspace(0, numpy.pi / 4, steps + 1))
    line = numpy.concatenate([-(0.5 - radius + bevel)[::-1], 0.5 - radius + bevel])
    a, b = numpy.meshgrid(line, line)
    faces = []
    for axis in range(3):
        for sign in (1, -1):
            cube = numpy.empty((*a.shape, 3))
            cube[..., axis], cube[..., (axis + 1) % 3], cube[..., (axis + 2) % 3] = 0.5 * sign, sign * a, b
            core = numpy.clip(cube, radius - 0.5, 0.5 - radius)
            normals = (cube - core) / numpy.linalg.norm(cube - core, axis=2, keepdims=True)
            faces.append(grid(core + radius * normals, normals))
    return joined(faces)


def leaf():
    """A leaf of length 1 along z, folded along its middle and hanging down."""
    t = numpy.linspace(0, 1, 7)[:, None] * numpy.ones(3)
    side = numpy.array([-1, 0, 1]) * 0.22 * numpy.sin(numpy.pi * t**0.8)
    points = numpy.stack([side, 0.25 * t - 0.45 * t**2 + 0.35 * numpy.abs(side), t], 2)
    return faceted(grid(points[:, ::-1], points))


def wave(width, height, folds, depth):
    """A hanging cloth in vertical folds, from y = 0 to `height`."""
    s = numpy.linspace(0, 1, 14 * folds + 1)
    phase = 2 * numpy.pi * folds * (s + 0.02 * numpy.sin(9 * s))
    x, z = width * s + 0.2 * depth * numpy.sin(2 * phase), depth * numpy.sin(phase) * (0.8 + 0.2 * numpy.sin(5 * s))
    points = numpy.stack([numpy.stack([x, y + 0 * x, z], 1) for y in (0.0, height)])
    return faceted(grid(points, points))


CUBE = faceted(joined([
    quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), quad((1, 0, 0), (-1, 0, 0), (0, 1, 0)), quad((1, 0, 1), (0, 0, -1), (0, 1, 0)),
    quad((0, 0, 0), (0, 0, 1), (0, 1, 0)), quad((0, 1, 1), (1, 0, 0), (0, 0, -1)), quad((0, 0, 0), (1, 0, 0), (0, 0, 1)),
]))
ROD = faceted(revolved([(0, 0), (1, 0), (1, 1), (0, 1)], 6))
BALL = revolved([(numpy.sin(a), -numpy.cos(a)) for a in numpy.linspace(0, numpy.pi, 15)])
BULB = faceted(ball((0, 0, 0), 1, 8))
RING = revolved([(1 + 0.08 * numpy.cos(a), 0.08 * numpy.sin(a)) for a in numpy.linspace(0, 2 * numpy.pi, 9)], 20)
# The only mesh with texture coordinates, apart from the floor.
PANEL = quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0))
ROUNDED, PILLOW, LEAF = rounded(0.2), rounded(0.44, 5), leaf()


def span(low, high):
    """Puts CUBE between two corners."""
    return at(low, size=numpy.subtract(high, low))


block = lambda low, high: CUBE.moved(span(low, high))
rod = lambda a, b, radius: ROD.moved(between(a, b, radius))


def border(width, height, bar, depth):
    """Four bars around a rectangle whose lower left corner is the origin."""
    return [
        block((-bar, -bar, 0), (0, height + bar, depth)), block((width, -bar, 0), (width + bar, height + bar, depth)),
        block((0, -bar, 0), (width, 0, depth)), block((0, height, 0), (width, height + bar, depth)),
    ]


def planks(random):
    """Two meters of boards of 12.5 cm, side by side along v, with dark gaps."""
    picture = numpy.empty((128, 128, 3))
    for board in range(0, 128, 8):
        grain = random.uniform(-6, 6, (8, 1, 1))
        picture[board:board + 8] = random.uniform(0.75, 1.1) * numpy.array((185, 135, 92)) + grain
        picture[board:board + 8, random.integers(128)] *= 0.45
        picture[board] *= 0.45
    return picture.clip(0, 255)


def carpet():
    """Frames and diamonds of four colors."""
    x, y = numpy.abs((numpy.arange(96) + 0.5) / 48 - 1)[None, :], numpy.abs((numpy.arange(64) + 0.5) / 32 - 1)[:, None]
    frames = (numpy.maximum(x * 1.5, y + 0.5) * 16).astype(int) % 3
    diamonds = ((2.4 * x + y) * 6).astype(int) % 4
    colors = numpy.array([(120, 30, 30), (200, 180, 140), (35, 45, 80), (160, 90, 40)])
    return colors[numpy.where(numpy.maximum(1.5 * x, y + 0.5) > 1.25, frames, diamonds)]


def landscape(random):
    """Hills before a sky."""
    x, y = numpy.arange(48)[None, :] / 47, numpy.arange(36)[:, None, None] / 35
    picture = numpy.array((235, 225, 200)) * (1 - y) + numpy.array(random.integers(120, 240, 3)) * y + numpy.zeros((1, 48, 1))
    for hill in range(4):
        a, b, c = random.uniform(0, 6, 3)
        edge = 0.35 + 0.16 * hill + 0.07 * numpy.sin(3 * x + a) + 0.03 * numpy.sin(9 * x + b)
        picture = numpy.where(y > edge[..., None], random.integers(25, 190, 3) * (0.9 - 0.12 * hill), picture)
    return picture.clip(0, 255)


matte = lambda *color: Material(color)
lamp = lambda strength: Material((0, 0, 0), emission=((1.0, 0.72, 0.42), strength))
WALL, PAPER, TRIM, CEILING = matte(0.72, 0.66, 0.57), matte(0.34, 0.45, 0.42), matte(0.8, 0.79, 0.76), matte(0.82, 0.81, 0.79)
OAK, WALNUT, BLACK, BRASS = matte(0.52, 0.33, 0.17), matte(0.2, 0.11, 0.06), matte(0.03, 0.03, 0.03), matte(0.55, 0.4, 0.15)
CHINA, CLAY, BLUE, PAGE = matte(0.8, 0.8, 0.78), matte(0.55, 0.25, 0.14), matte(0.12, 0.22, 0.4), matte(0.75, 0.7, 0.6)
CLOTH, PILLOWS = matte(0.25, 0.33, 0.38), [matte(0.7, 0.42, 0.1), matte(0.6, 0.55, 0.48), matte(0.5, 0.12, 0.1)]
CURTAIN, LEAVES = Material((0.68, 0.58, 0.42), double_sided=True), Material((0.12, 0.3, 0.07), double_sided=True)
STEM, SOIL, SHADE = matte(0.2, 0.25, 0.08), matte(0.05, 0.035, 0.025), matte(0.75, 0.7, 0.6)
FRUIT = [matte(0.7, 0.3, 0.05), matte(0.55, 0.07, 0.05), matte(0.45, 0.5, 0.1)]
MIRROR, GLOW = Material((0.92, 0.92, 0.92), mirror=True), lamp(22)


def wall(half, color, opening=None):
    """Boxes around an opening (left, right, bottom and top), with a skirting board and a cornice."""
    left, right, bottom, top = opening or (0, 0, 0, 0)
    low, high, wide = -0.2, HIGH + 0.2, half + 0.2
    parts = [block((-wide, low, -0.2), (left, high, 0)), block((right, low, -0.2), (wide, high, 0))]
    if opening:
        parts += [block((left, low, -0.2), (right, bottom, 0)), block((left, top, -0.2), (right, high, 0))]
    profile = ((-0.001, 0.09, 0.014), (HIGH - 0.03, HIGH + 0.01, 0.05), (HIGH - 0.07, HIGH - 0.03, 0.02))
    return [(joined(parts), color, at()), (joined([block((-half, a, -0.001), (half, b, out)) for a, b, out in profile]), TRIM, at())]


def window(width, height, columns, rows):
    """From the lower left corner of its opening: a frame with two casements, panes, a sill, a casing."""
    parts = [part.moved(at((0.05, 0.05, -0.14))) for part in border(width - 0.1, height - 0.1, 0.051, 0.06)]
    parts.append(block((width / 2 - 0.03, 0.04, -0.135), (width / 2 + 0.03, height - 0.04, -0.085)))
    for x in width * numpy.arange(1, columns) / columns:
        parts.append(block((x - 0.009, 0.04, -0.125), (x + 0.009, height - 0.04, -0.1)))
    for y in height * numpy.arange(1, rows) / rows:
        parts.append(block((0.04, y - 0.009, -0.127), (width - 0.04, y + 0.009, -0.098)))
    casing = [part.moved(at((0, 0, -0.001))) for part in border(width, height, 0.06, 0.016)]
    parts += [*casing, block((-0.1, -0.03, -0.08), (width + 0.1, 0.004, 0.07))]
    return [(joined(parts), TRIM, at())]


def drapes(width, height, sill, cloth):
    """Two curtains on rings on a rod."""
    top, wide, out = height + 0.13, 0.34, 0.1
    ends = (-wide - 0.06, top, out), (width + wide + 0.06, top, out)
    things = [(ROD, BLACK, between(*ends, 0.011)), *((BALL, BLACK, at(end, size=0.024)) for end in ends)]
    for left in (-wide - 0.02, width + 0.02):
        things.append((cloth, CURTAIN, at((left, 0.015 - sill, out))))
        things += [(RING, BRASS, at((left + wide * (i + 0.5) / 6, top - 0.012, out), lean=90, turn=9, size=0.023)) for i in range(6)]
    return things


def blinds(width, height, open_part):
    """Thin slats, half closed, down to `open_part` of the height; cords and a rail at the bottom."""
    z, low = -0.045, open_part * height
    slat, count = span((0.015, 0, 0), (width - 0.015, 0.0016, 0.044)), int((height - 0.04 - low) / 0.036)
    things = [(CUBE, TRIM, at((0, height - 0.03 - 0.036 * i, z), tilt=38) @ slat) for i in range(1, count)]
    things.append((CUBE, TRIM, span((0.01, height - 0.035, z - 0.025), (width - 0.01, height + 0.001, z + 0.025))))
    bottom = height - 0.035 - 0.036 * count
    things.append((CUBE, TRIM, span((0.015, bottom - 0.012, z - 0.02), (width - 0.015, bottom + 0.004, z + 0.02))))
    cords = [(width * part, z + side) for part in (0.12, 0.5, 0.88) for side in (-0.019, 0.027)]
    return things + [(ROD, PAGE, between((x, bottom, z), (x, height, z), 0.0015)) for x, z in cords]


def chair():
    """Thin legs, rungs and spindles."""
    parts = [block((-0.21, 0.43, -0.2), (0.21, 0.455, 0.21)), rod((-0.2, 0.93, -0.26), (0.2, 0.93, -0.26), 0.02)]
    parts.append(rod((-0.19, 0.58, -0.215), (0.19, 0.58, -0.215), 0.012))
    for x in (-0.19, 0.19):
        parts += [rod((x, -0.002, 0.19), (0.95 * x, 0.44, 0.18), 0.015), rod((x, -0.002, -0.21), (0.95 * x, 0.45, -0.185), 0.016)]
        parts += [rod((0.95 * x, 0.44, -0.185), (1.02 * x, 0.97, -0.268), 0.015)]
        parts += [rod((x, y, -0.2), (x, y, 0.19), 0.008) for y in (0.13, 0.25)]
    parts += [rod((x, 0.58, -0.215), (x, 0.93, -0.26), 0.006) for x in numpy.linspace(-0.15, 0.15, 7)]
    parts += [rod((-0.19, 0.19, z), (0.19, 0.19, z), 0.008) for z in (-0.19, 0.185)]
    return joined(parts)


def shelves(random):
    """A bookshelf of 0.9 x 1.78 x 0.3 m with books of random sizes and colors."""
    levels = (0.08, 0.45, 0.8, 1.14, 1.47, 1.78)
    boards = [block((-0.43, y - 0.022, 0.01), (0.43, y, 0.29)) for y in levels[1:-1]]
    boards += [block((-0.45, y - 0.022, 0.002), (0.45, y, 0.3)) for y in (levels[0], levels[-1])]
    boards += [block((x, 0, 0.004), (x + 0.02, 1.778, 0.298)) for x in (-0.449, 0.429)]
    things = [(joined([*boards, block((-0.44, 0.06, 0.003), (0.44, 1.77, 0.012))]), WALNUT, at())]
    colors = [matte(*color) for color in random.uniform(0.03, 0.6, (14, 3)).round(3)]
    cover = joined([block((0, 0, 0), (0.07, 1, 1)), block((0.93, 0, 0), (1, 1, 1)), block((0.07, 0, 0.97), (0.93, 1, 1))])
    pages = block((0.07, 0.02, 0.03), (0.93, 0.98, 0.97))
    for level in levels[:-1]:
        x, end = -0.42, random.uniform(0.2, 0.41)
        while x < end:
            size = random.uniform((0.018, 0.19, 0.15), (0.055, 0.29, 0.2))
            lean = random.uniform(8, 14) if random.random() < 0.1 else 0
            place = at((x, level - 0.001, 0.26 - size[2] + random.uniform(0, 0.02)), lean=-lean) @ at(size=size)
            x += size[0] + 0.0015 + size[1] * numpy.sin(numpy.radians(lean))
            if x > 0.425:
                break
            things += [(cover, colors[random.integers(14)], place), (pages, PAGE, place)]
    return things


def sofa():
    things = [(ROUNDED, CLOTH, at(center, size=size, tilt=tilt)) for center, size, tilt in (
        ((0, 0.24, 0), (1.56, 0.24, 0.8), 0), ((0, 0.5, -0.33), (1.52, 0.62, 0.2), -6),
        ((-0.77, 0.36, 0), (0.2, 0.5, 0.86), 0), ((0.77, 0.36, 0), (0.2, 0.5, 0.86), 0),
        ((-0.335, 0.42, 0.07), (0.66, 0.18, 0.72), 0), ((0.335, 0.42, 0.07), (0.66, 0.18, 0.72), 0),
        ((-0.335, 0.66, -0.2), (0.64, 0.42, 0.2), -14), ((0.335, 0.66, -0.2), (0.64, 0.42, 0.2), -14),
    )]
    things += [(ROD, WALNUT, between((x, -0.002, z), (0.97 * x, 0.16, 0.95 * z), 0.018)) for x in (-0.72, 0.72) for z in (-0.34, 0.36)]
    for (x, z, turn), color in zip(((-0.54, -0.02, 24), (-0.3, 0.03, -12), (0.55, -0.02, -26)), PILLOWS):
        things.append((PILLOW, color, at((x, 0.67, z), turn=turn, tilt=-22, size=(0.4, 0.38, 0.17), lean=8)))
    return things


def plant(random):
    """A pot and a dozen branches of 13 leaves."""
    line = numpy.array(curve([(0, 0, 0), (0, 0.3, 0.05), (0, 0.58, 0.16), (0, 0.78, 0.36)], 5))
    stem = joined([rod(a, b, 0.006 - 0.0003 * i) for i, (a, b) in enumerate(zip(line, line[1:]))])
    leaves = [LEAF.moved(at(line[-1], tilt=20, size=0.2))]
    for i in range(12):
        turn, tilt, size = random.uniform((-25, -25, 0.15), (25, 15, 0.23))
        leaves.append(LEAF.moved(at(line[3 + i], turn=turn + 75 * (-1) ** i, tilt=tilt, size=size)))
    leaves, soil = joined(leaves), revolved([(0, 0.2), (0.145, 0.2), (0.145, 0.27), (0, 0.28)])
    pot = revolved(shell([(0, 0), (0.1, 0), (0.12, 0.02), (0.16, 0.27), (0.172, 0.275), (0.172, 0.31)], 0.012))
    things = [(pot, CLAY, at((0, -0.001, 0))), (soil, SOIL, at())]
    for i in range(12):
        place = at((0, 0.26, 0), turn=137.5 * i, tilt=random.uniform(-18, 22), size=random.uniform(0.75, 1.25))
        things += [(stem, STEM, place), (leaves, LEAVES, place)]
    return things


BOWL = revolved(shell([(0, 0), *curve([(0.05, 0.0), (0.06, 0.012), (0.11, 0.05), (0.14, 0.1)])], 0.004))
CUP = revolved(shell([(0, 0), *curve([(0.025, 0), (0.035, 0.02), (0.04, 0.08)])], 0.003), 20)
PLATE = revolved(shell([(0, 0), (0.07, 0.002), (0.085, 0.008), (0.125, 0.018)], 0.004))
BOTTLE = [(0.06, 0.0), (0.085, 0.06), (0.075, 0.16), (0.025, 0.24), (0.022, 0.29), (0.035, 0.32)]
BOTTLE = revolved([(0, 0), *curve(BOTTLE), (0.028, 0.32), (0.018, 0.28), (0, 0.27)])
FOOT = revolved([(0, 0), *curve([(0.12, 0), (0.115, 0.015), (0.03, 0.03), (0.012, 0.05)]), (0, 0.06)])
STAND = [(0.055, 0), (0.055, 0.012), (0.02, 0.03), (0.05, 0.09), (0.045, 0.14), (0.012, 0.18), (0.012, 0.23)]
STAND = revolved([(0, 0), *curve(STAND), (0, 0.24)])
CONE = faceted(revolved([(0, 0), (0.1, 0), (0.07, 0.15), (0, 0.15)], 20))


def table_lamp(color):
    """A small lamp whose shade is a closed body that shines."""
    return [(STAND, color, at((0, -0.001, 0))), (CONE, GLOW, at((0, 0.22, 0))),
            (RING, BRASS, at((0, 0.22, 0), size=0.1)), (RING, BRASS, at((0, 0.37, 0), size=0.07))]


def floor_lamp(strength):
    shade = shell([(0.2, 0), (0.12, 0.24)], 0.003)
    things = [(FOOT, BLACK, at((0, -0.001, 0))), (revolved([*shade, shade[0]], 36), SHADE, at((0, 1.38, 0))),
              (ROD, BLACK, between((0, 0.04, 0), (0, 1.56, 0), 0.008)), (BULB, lamp(strength), at((0, 1.51, 0), size=0.045))]
    spokes = ((0.133 * numpy.sin(a), 1.575, 0.133 * numpy.cos(a)) for a in (0, 2.1, 4.2))
    return things + [(ROD, BLACK, between((0, 1.56, 0), end, 0.002)) for end in spokes]


def pendant(length, strength):
    """From the ceiling, an opaque shade around a bulb."""
    shade = shell(curve([(0.19, 0), (0.17, 0.07), (0.1, 0.15), (0.02, 0.18)]), 0.003)
    return [(ROD, BLACK, between((0, 0.17 - length, 0), (0, 0.01, 0), 0.004)),
            (ROD, BLACK, between((0, 0.09 - length, 0), (0, 0.18 - length, 0), 0.012)),
            (revolved([*shade, shade[0]], 36), BRASS, at((0, -length, 0))),
            (BULB, lamp(strength), at((0, 0.05 - length, 0), size=0.045))]


def sconce(strength):
    """A bare bulb on an arm."""
    return [(CUBE, BRASS, span((-0.03, -0.06, -0.001), (0.03, 0.06, 0.008))), (ROD, BRASS, between((0, 0, -0.002), (0, 0, 0.09), 0.006)),
            (ROD, BRASS, between((0, -0.005, 0.085), (0, 0.06, 0.085), 0.006)), (CUP, BRASS, at((0, 0.03, 0.085))),
            (BULB, lamp(strength), at((0, 0.112, 0.085), size=0.045))]


def environment():
    """The sky of the npm package @pmndrs/assets 1.7.0 (CC0) at half its size, turned so that the sun shines into both windows.

    What is brighter than 50 times the mean is cut, so that references converge.  Texels have few digits, so that the file is small.  Only
    where `sky.exr` of that package lies beside this program is the image made again."""
    original = pathlib.Path(__file__).with_name("sky.exr")
    with OpenEXR.File(str(original if original.exists() else FOLDER / "interior_environment.exr")) as file:
        image = file.channels()["RGB"].pixels
    if not original.exists():
        return image
    image = numpy.maximum(image, 0).reshape(128, 2, 256, 2, 3).mean((1, 3))
    weights = numpy.sin(numpy.pi * (numpy.arange(128) + 0.5) / 128)[:, None]
    gray = image.mean(2)
    limit = 50 * (gray * weights).sum() / (256 * weights.sum())
    image *= numpy.minimum(1, limit / numpy.maximum(gray, 1e-9))[..., None]
    fraction, exponent = numpy.frexp(7 * numpy.roll(image, -50, 1))
    return numpy.ldexp((256 * fraction).round() / 256, exponent).astype(numpy.float32)


NORTH, SOUTH = at((0, 0, -DEEP)), at((0, 0, DEEP), turn=180)
WEST, EAST = at((-WIDE, 0, 0), turn=90), at((WIDE, 0, 0), turn=-90)


def building(put, random):
    """Walls with windows, floor and ceiling."""
    view, side = (-0.95, 0.4, 0.85, 2.3), (0.45, 1.25, 0.85, 2.3)
    put(wall(WIDE, PAPER, view), NORTH)
    put(wall(DEEP, WALL, side), WEST)
    put(wall(WIDE, WALL), SOUTH)
    put(wall(DEEP, WALL), EAST)
    boards = Material(base=Texture(planks(random), True, scale=(2.7, 2.2)))
    put([(quad((-2.7, 0, 2.2), (5.4, 0, 0), (0, 0, -4.4)), boards, at())])
    put([(CUBE, CEILING, span((-2.7, HIGH, -2.2), (2.7, HIGH + 0.2, 2.2)))])
    cloth = wave(0.34, 2.4, 6, 0.035)
    for (left, right, sill, top), where, panes in ((view, NORTH, (4, 4)), (side, WEST, (2, 3))):
        size = right - left, top - sill
        put(window(*size, *panes) + drapes(*size, sill, cloth), where @ at((left, sill, 0)))
    put(blinds(*size, 0.22), WEST @ at((left, sill, 0)))


def decoration(put, random):
    """What stands and hangs at the walls."""
    put(shelves(random) + [(BOTTLE, BLUE, at((0.23, 1.779, 0.16)))], NORTH @ at((-2.03, 0, 0.01)))
    put(table_lamp(CLAY), NORTH @ at((-2.2, 1.78, 0.17)))
    put(floor_lamp(180), at((-1.32, 0, -1.52)))
    put(sofa(), at((-0.27, 0, -1.4)))
    put(plant(random), at((0.95, 0, -1.5)))
    put(sconce(68), NORTH @ at((1.25, 1.7, 0)))
    frame = lambda width, height: joined([*border(width, height, 0.02, 0.022), block((0, 0, -0.001), (width, height, 0.006))])
    frames = {width: frame(width, 0.28) for width in (0.36, 0.22)}
    places = [(WEST, x, y, 0.36) for x in (-1.38, -0.93) for y in (1.3, 1.68)] + [(EAST, -0.6, 1.5, 0.36), (SOUTH, 0.3, 1.5, 0.36)]
    for where, x, y, width in places + [(NORTH, x, y, 0.22) for x in (1.4, 1.75) for y in (1.4, 1.8)]:
        # Pictures have their first row at the top, and v runs up.
        picture = Material(base=Texture(landscape(random), True, scale=(1, -1)))
        picture = (PANEL, picture, at((width / 2, 0.14, 0.0061), size=(width - 0.06, 0.22, 1)))
        put([(frames[width], BLACK, at()), picture], where @ at((x, y, 0)))
    mirror = (PANEL, MIRROR, at((0.25, 0.375, 0.0061), size=(0.5, 0.75, 1)))
    put([(frame(0.5, 0.75), BRASS, at()), mirror], WEST @ at((-0.47, 1.15, 0)))
    # A sideboard under the mirror.
    drawers = [(x, y) for x in (-0.4, -0.133, 0.134) for y in (0.22, 0.43)]
    fronts = [block((x + 0.006, y, 0.36), (x + 0.26, y + 0.2, 0.376)) for x, y in drawers]
    board = [block((-0.41, 0.2, 0.01), (0.41, 0.65, 0.362)), block((-0.43, 0.649, 0.005), (0.43, 0.67, 0.385))]
    board += [rod((x, -0.002, z), (0.95 * x, 0.21, z), 0.014) for x in (-0.38, 0.38) for z in (0.05, 0.33)]
    things = [(joined(board), WALNUT, at()), (joined(fronts), OAK, at())]
    things += [(BALL, BRASS, at((x + 0.133, y + 0.1, 0.385), size=0.012)) for x, y in drawers]
    things += [(BOTTLE, CHINA, at((0.28, 0.669, 0.16), size=0.9)), (BOWL, BLUE, at((0.03, 0.669, 0.2), size=0.7))]
    put(things, WEST @ at((-0.25, 0, 0)))
    put(table_lamp(CHINA), WEST @ at((-0.52, 0.67, 0.18)))


def tables(put, random):
    """A table with chairs; a low one on a rug, with a lamp."""
    wood = [block((-0.4, 0.72, -0.65), (0.4, 0.75, 0.65)), block((-0.34, 0.65, -0.59), (0.34, 0.721, 0.59))]
    wood += [rod((x, -0.002, z), (0.95 * x, 0.7, 0.97 * z), 0.022) for x in (-0.35, 0.35) for z in (-0.6, 0.6)]
    place, seat, cushion = at((-0.85, 0, 0.5)), chair(), at((0, 0.475, 0.01), size=(0.38, 0.05, 0.37))
    things = [(joined(wood), OAK, at()), (BOWL, CLAY, at((0, 0.749, 0)))]
    fruit = ((0, 0.79, 0), (-0.07, 0.8, 0.02), (0.06, 0.8, 0.03), (0.02, 0.8, -0.07), (0, 0.85, 0.01))
    things += [(BALL, FRUIT[i % 3], at(position, size=0.036)) for i, position in enumerate(fruit)]
    for x, z, turn in ((0.62, -0.3, -93), (0.66, 0.34, -80), (-0.6, -0.33, 88), (-0.62, 0.33, 95)):
        things += [(seat, WALNUT, at((x, 0, z), turn=turn)), (ROUNDED, CLOTH, at((x, 0, z), turn=turn) @ cushion)]
        x = numpy.sign(x)
        things += [(PLATE, CHINA, at((0.25 * x, 0.749, z))), (CUP, BLUE, at((0.2 * x, 0.749, z + 0.2)))]
    put(things + [(mesh, material, at((0, HIGH, 0)) @ matrix) for mesh, material, matrix in pendant(1.15, 180)], place)
    put([(seat, TRIM, at()), (ROUNDED, PILLOWS[0], cushion)], at((1.25, 0, -0.45), turn=-62))

    rug, strand = at((0.4, 0, -0.55), turn=4), span((0, 0.001, -0.0015), (0.07, 0.004, 0.0015))
    fringe = joined([CUBE.moved(at((0, 0, 0.015 * i), turn=random.uniform(-9, 9)) @ strand) for i in range(16)])
    pattern = Material(base=Texture(carpet(), True, nearest=True))
    put([(CUBE, CLAY, span((-0.75, -0.002, -0.48), (0.75, 0.007, 0.48)))], rug)
    put([(PANEL, pattern, at((0, 0.0071, 0), tilt=-90, size=(1.5, 0.96, 1)))], rug)
    put([(fringe, PAGE, at(turn=turn) @ at((0.74, 0, 0.24 * i - 0.47))) for i in range(4) for turn in (0, 180)], rug)
    wood = [revolved([(0, 0.395), (0.3, 0.395), (0.31, 0.401), (0.31, 0.41), (0.3, 0.415), (0, 0.415)], 48)]
    for a in (0.5, 2.6, 4.7):
        x, z = numpy.sin(a), numpy.cos(a)
        wood.append(rod((0.24 * x, 0, 0.24 * z), (-0.16 * x, 0.4, -0.16 * z), 0.009))
    things = [(joined(wood), OAK, at()), (BOTTLE, CLAY, at((-0.12, 0.414, -0.06))), (CUP, CHINA, at((0.15, 0.414, 0.12)))]
    put(things, rug @ at((0.2, 0.006, 0)))
    put(table_lamp(BLUE), rug @ at((0.22, 0.421, -0.12)))


def interior():
    note = "a furnished room: thin edges everywhere, a sky behind two windows, six lamps"
    scene = Scene(6, ((2.3, 1.6, 1.6), (-0.45, 0.87, -0.66), 58), note)
    scene.environment = environment()

    def put(things, where=at()):
        for mesh, material, matrix in things:
            # Few digits, for a small file; + 0.0 makes -0.0 positive.
            scene.add(mesh, material, (where @ matrix).round(6) + 0.0)

    random = numpy.random.default_rng(7)
    for part in (building, decoration, tables):
        part(put, random)
    return scene
