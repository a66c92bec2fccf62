"""Slabs between smooth faces by adding and doubling in plain NumPy: ``python tests/reference/make_mismatched.py``.

Writes mismatched_doubling.csv: the scenes of plane_parallel/mismatched_totals.csv anew, because the uncertainties stated there are too small: its
rows of thick slabs lie up to 1.1 of them from the exact half spaces of the H-function, with which this agrees to 5e-8.

It shares no rule and no formula of solution with the package: nodes crowd at both ends of the two ranges that the critical angle divides, a layer of
1e-5 optical depths is made by the trapezoidal rule and doubled, the faces are added at the end.
"""

import csv
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
NODES = 100  # in each range; 80 move no value by more than 4e-7
THINNEST = 1e-5


def rule(n):
    """Cosines inside and their weights, the beam last: it carries no weight."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    t = 0.5 * (1.0 + x)
    s, ds = t**3 * (10.0 - 15.0 * t + 6.0 * t**2), 15.0 * w * (t * (1.0 - t)) ** 2
    critical = np.sqrt(1.0 - n**-2)
    return np.concatenate([critical * s, critical + (1.0 - critical) * s, [1.0]]), np.concatenate([critical * ds, (1.0 - critical) * ds, [0.0]])


def four_directions(n):
    """Inverse adding-doubling's rule of four points: two of Gauss below the cosine of the critical angle, two of Radau above it."""
    critical, half = np.sqrt(1.0 - n**-2), 0.5 / np.sqrt(3.0)
    mu = np.array([critical * (0.5 - half), critical * (0.5 + half), critical + (1.0 - critical) / 3.0, 1.0])
    return mu, np.array([0.5 * critical, 0.5 * critical, 0.75 * (1.0 - critical), 0.25 * (1.0 - critical)])


def reflectance(mu, n):
    """Fresnel's, from within."""
    sine = n * np.sqrt(1.0 - mu**2)
    out = np.sqrt(np.maximum(1.0 - sine**2, 0.0))
    s, p = (n * mu - out) / (n * mu + out), (mu - n * out) / (mu + n * out)
    return np.where(sine >= 1.0, 1.0, 0.5 * (s**2 + p**2))


def slab(mu, W, g, albedo, tau, thinnest=THINNEST):
    """Reflection and transmission between powers in all directions."""
    l = np.arange(1 if g == 0.0 else min(int(np.log(1e-14) / np.log(g)) + 2, 400))
    P = np.polynomial.legendre.legvander(mu, l.size - 1)
    same, other = (P * (2 * l + 1) * g**l) @ P.T, (P * (2 * l + 1) * (-g) ** l) @ P.T
    doublings = max(0, int(np.ceil(np.log2(tau / thinnest))))
    h = 0.5 * tau / 2.0**doublings
    one = np.eye(mu.size)
    lost, turned = h * (one - 0.5 * albedo * W[:, None] * same) / mu, h * 0.5 * albedo * W[:, None] * other / mu
    size = mu.size
    S = np.linalg.solve(np.block([[one + lost, -turned], [-turned, one + lost]]), np.block([[one - lost, turned], [turned, one - lost]]))
    T, R = S[:size, :size], S[:size, size:]
    for _ in range(doublings):
        first = T @ np.linalg.inv(one - R @ R)
        R, T = R + first @ R @ T, first @ T
    return R, T


def totals(n, g, albedo, tau, directions=rule, thinnest=THINNEST):
    """R and T at normal incidence, then of diffuse light, first-surface reflection included."""
    mu, W = directions(n)
    R, T = slab(mu, W, g, albedo, tau, thinnest)
    r = reflectance(mu, n)
    one, mirror = np.eye(mu.size), np.diag(r)
    to_and_fro = np.linalg.inv(one - R @ mirror)
    R, T = R + T @ mirror @ to_and_fro @ T, (1.0 - r)[:, None] * (to_and_fro @ T)  # with the lower face
    entered = np.linalg.inv(one - mirror @ R)
    R, T = (1.0 - r) @ R @ entered, T.sum(axis=0) @ entered
    normal = 4.0 * n / (n + 1.0) ** 2
    escaping = n * np.sqrt(1.0 - mu**2) < 1.0
    diffuse = 2.0 * n**2 * mu * W * escaping
    inside = diffuse * (1.0 - r)
    return 1.0 - normal + normal * R[-1], normal * T[-1], diffuse @ r + R @ inside, T @ inside


def main():
    with (FOLDER / "plane_parallel" / "mismatched_totals.csv").open() as file:
        scenes = [row for row in csv.reader(file) if not row[0].startswith("#")]
    with (FOLDER / "mismatched_doubling.csv").open("w") as file:
        file.write("n,g,albedo,tau,R_normal,T_normal,R_diffuse,T_diffuse\n")
        for row in scenes[1:]:
            values = totals(*(float(x) for x in row[:4]))
            file.write(",".join(row[:4]) + "," + ",".join(f"{value:.9e}" for value in values) + "\n")


if __name__ == "__main__":
    main()
