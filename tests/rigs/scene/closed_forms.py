"""Light's way through simple optics, in closed form: what a traced path is compared with.

Nothing here is of the package. Angles are in radians, directions are unit vectors, and indices are
relative to vacuum. Sources: [BW] Born and Wolf, "Principles of Optics", 7th edition; [LK] Lowe and
Kutt, "Refraction through cylindrical tubes", Experiments in Fluids 13 (1992).
"""

import math

import numpy as np


def behind_plate(origins, directions, normal, thickness, index):
    """Return points ``(N, 3)`` on the rays behind a plate; directions stay as they are.

    The part ``d_t`` of a direction along the faces is that in air over ``n`` in the plate. The way
    across the plate is ``t`` in both, so the shift is ``t d_t (1 / (n cos b) - 1 / cos a)``.
    """
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    cosine = directions @ normal
    normal = np.sign(cosine)[:, None] * normal
    cosine = np.abs(cosine)
    along = directions - cosine[:, None] * normal
    inside = np.sqrt(index**2 - 1 + cosine**2)  # n cos b
    return origins + thickness * along * (1 / inside - 1 / cosine)[:, None]


def prism_deviation(apex, incidence, index):
    """Return the angle by which a prism in air turns a ray in its principal section.

    ``i - A + arcsin(sin A sqrt(n² - sin² i) - cos A sin i)`` ([BW] 4.7.2); ``i`` from the normal
    of the first face, positive towards the base. NaN where the second face reflects totally.
    """
    sine = np.sin(incidence)
    leaving = np.sin(apex) * np.sqrt(index**2 - sine**2) - np.cos(apex) * sine
    with np.errstate(invalid="ignore"):
        return incidence - apex + np.arcsin(leaving)


def ball_focus(diameter, index):
    """Return the distance from a ball's middle to its paraxial focus, ``n D / (4 (n - 1))``.

    The thick lens of two spheres of one middle ([BW] 4.4.3); it is the effective focal length.
    """
    return index * diameter / (4 * (index - 1))


def ball_crossing(height, diameter, index):
    """Return the distance from a ball's middle at which a ray parallel to the axis crosses it.

    A ray at ``height`` is turned by ``2 (i - r)``, ``sin i = n sin r = 2 h / D``. Its distance
    from the middle is ``h`` behind the ball too: it crosses the axis at ``h / sin 2 (i - r)``.
    """
    sine = 2 * np.asarray(height, float) / diameter
    return height / np.sin(2 * (np.arcsin(sine) - np.arcsin(sine / index)))


def tube_path(origin, direction, radii, indices):
    """Return a path through coaxial cylinders around the axis z.

    Parameters
    ----------
    origin, direction : (3,) array_like
        Of a ray from outside that meets the outermost cylinder.
    radii : sequence of float
        From the outermost to the innermost.
    indices : sequence of float
        Outside, between the cylinders in the order of ``radii``, and inside: one more.

    Returns
    -------
    points : (N, 3) float64
        Where the path meets a cylinder.
    directions : (N, 3) float64
        Those from there on.

    Raises
    ------
    ValueError
        If the ray misses, or is reflected totally.

    Notes
    -----
    Along z, ``n d_z`` stays. Across the axis light travels as in a plane of the indices
    ``m = sqrt(n² - (n d_z)²)``, where Bouguer's ``m b`` stays, ``b`` the distance of the straight
    piece from the axis ([BW] 3.2.1, [LK]). A point at the radius R on the way in has the polar
    angle ``φ + π - arcsin(b / R)``, on the way out ``φ + arcsin(b / R)``, with the angle ``φ`` of
    the piece: both pieces at a crossing share the point, which gives the turn.
    """
    origin, direction = np.asarray(origin, float), np.asarray(direction, float)
    lifted = indices[0] * direction[2]
    across = [math.sqrt(n**2 - lifted**2) for n in indices]
    angle = math.atan2(direction[1], direction[0])
    constant = across[0] * (origin[1] * math.cos(angle) - origin[0] * math.sin(angle))
    distances = [constant / m for m in across]
    if abs(distances[0]) >= radii[0]:
        raise ValueError("the ray misses the tube")
    deepest = len(radii)
    for layer, radius in enumerate(radii):
        if abs(distances[layer]) >= radius:
            deepest = layer
            break
        if abs(distances[layer + 1]) >= radius:
            raise ValueError("total reflection")
    crossings = [(layer, layer, layer + 1, -1) for layer in range(deepest)]
    crossings += [(layer, layer + 1, layer, +1) for layer in reversed(range(deepest))]
    ahead = origin[0] * math.cos(angle) + origin[1] * math.sin(angle)
    height, points, directions = origin[2], [], []
    for cylinder, before, after, way in crossings:
        radius, (near, far) = radii[cylinder], (distances[before], distances[after])
        reached = way * math.sqrt(radius**2 - near**2)
        height += (reached - ahead) * lifted / across[before]
        points.append([*_turned(reached, near, angle), height])
        turn = math.asin(far / radius) - math.asin(near / radius)
        angle += turn if way < 0 else -turn
        ahead = way * math.sqrt(radius**2 - far**2)
        level = across[after] / indices[after]
        directions.append(
            [level * math.cos(angle), level * math.sin(angle), lifted / indices[after]]
        )
    return np.array(points), np.array(directions)


def _turned(along, left, angle):
    """Return the vector that lies so far along and left of a direction of this angle."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return along * cosine - left * sine, along * sine + left * cosine


def mirror_image(points, point, normal):
    """Return points ``(N, 3)`` reflected in a plane, as a camera is to its virtual camera."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    return points - 2 * ((points - np.asarray(point, float)) @ normal)[:, None] * normal


def mirrored_directions(directions, normal):
    """Return directions ``(N, 3)`` reflected in a plane."""
    return mirror_image(directions, np.zeros(3), normal)


def fresnel_transmission(angle, before, after):
    """Return the fraction of unpolarised light that passes a surface between two indices.

    One minus the mean of ``(sin(a - b) / sin(a + b))²`` and ``(tan(a - b) / tan(a + b))²``; at
    normal incidence ``4 n m / (n + m)²`` ([BW] 1.5.3). None passes beyond the critical angle.
    """
    angle = np.asarray(angle, float)
    sine = before / after * np.sin(angle)
    total = np.abs(sine) >= 1
    other = np.arcsin(np.where(total, 0, sine))
    apart, both = angle - other, angle + other
    straight = 1 - 4 * before * after / (before + after) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        across = (np.sin(apart) / np.sin(both)) ** 2
        within = (np.tan(apart) / np.tan(both)) ** 2
    reflected = np.where(angle == 0, straight, (across + within) / 2)
    return np.where(total, 0.0, 1 - reflected)


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
