"""Stored values of R(r) in arbitrary precision, for the test of the Hankel inversion.

    python tests/reference/make_hankel.py        # needs mpmath; writes tests/reference/hankel.json, a few minutes

Method: R(r) = (1/2 pi) Re int k F(k) H0(k r) dk from i c to infinity at 45 degrees (30 digits), c below the nearest singularity of F: all of them
lie on the imaginary axis, and between 0 and i c the integrand is imaginary. On this path it carries the factor exp(-c r) and decays without
oscillation, so that no digits cancel. F is written here once more, from the textbook: the multipole with hyperbolic functions and
the Kubelka-Munk sum (Donner & Jensen 2005, eqs 21, 22); layered diffusion by solving for the amplitudes of growing and decaying exponentials.
"""

import json
from pathlib import Path

import mpmath as mp

mp.mp.dps = 30


def moments(n):
    """R1, R2 by quadrature of the Fresnel formula."""
    n = mp.mpf(n)

    def R(mu):
        sin2 = (1 - mu**2) * n**2
        if sin2 >= 1:
            return mp.mpf(1)
        t = mp.sqrt(1 - sin2)
        return (((n * mu - t) / (n * mu + t)) ** 2 + ((mu - n * t) / (mu + n * t)) ** 2) / 2

    if n == 1:
        return mp.mpf(0), mp.mpf(0)
    critical = mp.sqrt(1 - 1 / n**2) if n > 1 else mp.mpf(0)
    edges = [critical, *(critical + (1 - critical) * mp.mpf(10) ** (-j) for j in range(8, -1, -1))]
    first = mp.quad(lambda m: R(m) * m, edges) + critical**2 / 2
    second = mp.quad(lambda m: R(m) * m**2, edges) + critical**3 / 3
    return 2 * first, 3 * second


def mismatch(n):
    R1, R2 = moments(n)
    return (1 + R2) / (1 - R1)


def multipole_slab(sigma_a, sigma_s, d, A0, A1):
    sigma_a, sigma_s, d = map(mp.mpf, (sigma_a, sigma_s, d))
    l = 1 / (sigma_a + sigma_s)
    zb0, zb1 = 2 * A0 * l / 3, 2 * A1 * l / 3
    L = d + zb0 + zb1

    def RT(k, z0=zb0, z1=zb1):
        gamma = mp.sqrt(k**2 + 3 * sigma_a / l)
        alpha = sigma_s * l
        return (
            alpha * mp.sinh(gamma * (d + z1 - l)) * mp.cosh(gamma * z0) / mp.sinh(gamma * L),
            alpha * mp.sinh(gamma * (l + z0)) * mp.cosh(gamma * z1) / mp.sinh(gamma * L),
        )

    return lambda k: RT(k), lambda k: RT(k, zb1, zb0)


def multipole_half(sigma_a, sigma_s, A0):
    sigma_a, sigma_s = mp.mpf(sigma_a), mp.mpf(sigma_s)
    l = 1 / (sigma_a + sigma_s)
    zb = 2 * A0 * l / 3

    def R(k):
        gamma = mp.sqrt(k**2 + 3 * sigma_a / l)
        return sigma_s * l / 2 * (mp.exp(-gamma * l) + mp.exp(-gamma * (l + 2 * zb)))

    return R


def layered_diffusion(layers, n, half_space):
    """Exitance of N layers of one index: D = 1/(3 sigma_t'), point in the first layer at the mean transport depth of what the sample removes
    from the beam, phi = 0 at the extrapolated boundary of a medium with D and sigma_a averaged over the layers by what they remove.

    Returns F(k) = (1 - R1)/4 phi + (1 - R2)/2 J per unit power that has entered.
    """
    R1, R2 = moments(n)
    A = (1 + R2) / (1 - R1)
    rows = [(mp.mpf(a), mp.mpf(s), None if d is None else mp.mpf(d)) for a, s, d in layers]
    D = [1 / (3 * (a + s)) for a, s, _ in rows]
    shares = removed(rows)
    tau = -mp.log(1 - sum(shares)) if not half_space else mp.inf
    first_depth = (1 if half_space else 1 - tau / mp.expm1(tau)) / (rows[0][0] + rows[0][1])
    power = sum(w * s / (a + s) for w, (a, s, _) in zip(shares, rows, strict=True))
    D_edge = sum(w * Di for w, Di in zip(shares, D, strict=True)) / sum(shares)
    sigma_a_edge = sum(w * a for w, (a, _, _) in zip(shares, rows, strict=True)) / sum(shares)
    zb_last = 2 * A * D[-1]

    def at(k, z0):
        g = [mp.sqrt(k**2 + a / Di) for (a, _, _), Di in zip(rows, D, strict=True)]
        # layer i: a_i exp(-g (z - top)) + b_i exp(-g (bottom - z)); unknowns in order
        count = 2 * len(rows) - (1 if half_space else 0)
        M, v = mp.matrix(count, count), mp.matrix(count, 1)
        tops = [mp.mpf(0)]
        for _, _, d in rows:
            if d is not None:
                tops.append(tops[-1] + d)
        source = power / (2 * D[0] * g[0])
        # extrapolated boundary: phi = 2 A tanh(x)/x times the outward flux D phi'
        x = 2 * A * D_edge * mp.sqrt(k**2 + sigma_a_edge / D_edge)
        ratio = 2 * A * mp.tanh(x) / x * D[0] * g[0]
        M[0, 0] = 1 + ratio
        if not (half_space and len(rows) == 1):
            M[0, 1] = mp.exp(-g[0] * rows[0][2]) * (1 - ratio)
        v[0] = -source * mp.exp(-g[0] * z0) * (1 - ratio)
        row = 1
        for i in range(len(rows) - 1):
            d = rows[i][2]
            e = mp.exp(-g[i] * d)
            extra = source * mp.exp(-g[0] * (d - z0)) if i == 0 else mp.mpf(0)
            last = i + 1 == len(rows) - 1 and half_space
            M[row, 2 * i], M[row, 2 * i + 1], M[row, 2 * i + 2] = e, 1, -1
            M[row + 1, 2 * i], M[row + 1, 2 * i + 1], M[row + 1, 2 * i + 2] = D[i] * g[i] * e, -D[i] * g[i], -D[i + 1] * g[i + 1]
            if not last:
                e2 = mp.exp(-g[i + 1] * rows[i + 1][2])
                M[row, 2 * i + 3], M[row + 1, 2 * i + 3] = -e2, D[i + 1] * g[i + 1] * e2
            v[row], v[row + 1] = -extra, -D[i] * g[i] * extra
            row += 2
        if not half_space:
            i = len(rows) - 1
            d = rows[i][2]
            M[row, 2 * i], M[row, 2 * i + 1] = mp.exp(-g[i] * (d + 2 * zb_last)), 1
            v[row] = -source * mp.exp(-g[0] * (d + 2 * zb_last - z0)) if i == 0 else 0
        x = mp.lu_solve(M, v)
        b = x[1] * mp.exp(-g[0] * rows[0][2]) if not (half_space and len(rows) == 1) else 0
        direct = source * mp.exp(-g[0] * z0)
        phi = x[0] + b + direct
        J = D[0] * g[0] * (-x[0] + b + direct)
        return (1 - R1) / 4 * phi + (1 - R2) / 2 * J

    if half_space:
        return lambda k: at(k, first_depth)
    # what passes a slab (of one layer) is partly reflected at its lower face and feeds a second point, and so on
    back = ((mp.mpf(n) - 1) / (mp.mpf(n) + 1)) ** 2 * mp.exp(-tau)
    return lambda k: (at(k, first_depth) + back * at(k, rows[0][2] - first_depth)) / (1 - back**2)


def removed(rows):
    """Share of the beam that each layer removes."""
    shares, left = [], mp.mpf(1)
    for a, s, d in rows:
        passing = 0 if d is None else mp.exp(-(a + s) * d)
        shares.append(left * (1 - passing))
        left *= passing
    return shares


def profile(F, sigma_min, radii):
    values = []
    start, direction = mp.mpc(0, mp.mpf("0.6") * sigma_min), mp.expjpi(mp.mpf(1) / 4)
    for r in map(mp.mpf, radii):

        def f(t, r=r):
            k = start + t * direction
            return mp.re(k * F(k) * mp.hankel1(0, k * r) * direction)

        end = min(mp.mpf(110), 110 / r)  # F has died out, or H0 has
        edges = [0, *(end * mp.mpf(2) ** (j - 12) for j in range(13))]
        values.append(mp.nstr(mp.quad(f, edges, method="gauss-legendre", maxdegree=4) / (2 * mp.pi), 17))
    return values


def main():
    A = mismatch("1.4")
    slab, _ = multipole_slab("0.01", "1", "5", A, A)
    upper, upper_below = multipole_slab("0.02", "1.5", "2", A, mp.mpf(1))
    lower = multipole_half("0.01", "1", mp.mpf(1))

    def two(k):
        R1, T1 = upper(k)
        R1b, T1u = upper_below(k)
        R2 = lower(k)
        return R1 + T1u * R2 * T1 / (1 - R1b * R2)

    radii = ["0.01", "0.1", "0.3", "1", "2", "4", "7", "10", "15", "20", "26", "32", "40", "50", "60"]
    s1, s2 = mp.sqrt(3 * mp.mpf("0.01") * mp.mpf("1.01")), mp.sqrt(3 * mp.mpf("0.02") * mp.mpf("1.52"))
    diffusion_slab = layered_diffusion([("0.01", "1", "5")], "1.4", False)
    diffusion_two = layered_diffusion([("0.02", "1.5", "2"), ("0.01", "1", None)], "1.4", True)
    result = {
        "method": " ".join(__doc__.split()),
        "r_mm": radii,
        "per unit power that has entered": True,
        "multipole slab: sigma_a 0.01, sigma_s' 1, d 5, n 1.4": profile(lambda k: slab(k)[0], s1, radii),
        "multipole two layers: 0.02, 1.5, 2 mm over 0.01, 1; n 1.4": profile(two, min(s1, s2), radii),
        "layered diffusion slab: sigma_a 0.01, sigma_s' 1, d 5, n 1.4": profile(diffusion_slab, s1, radii),
        "layered diffusion two layers: 0.02, 1.5, 2 mm over 0.01, 1; n 1.4": profile(diffusion_two, min(s1, s2), radii),
    }
    Path(__file__).with_name("hankel.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
