"""300 measured spectra of human skin (100 people, three each) fitted with two layers by discrete ordinates: how well, how alike, how fast.

python benchmarks/nist_skin.py [--data FOLDER] [--people N]

Writes docs/nist-skin.md, docs/nist-skin.png and benchmarks/results/nist_skin.json. FOLDER holds M38597.csv.gz of the NIST reference data set of human
skin reflectance (DOI 10.18434/M38597; C. C. Cooksey, D. W. Allen and B. K. Tsai, J. Res. NIST 122, 26 (2017)), 8 degrees to hemisphere.

Model: an epidermis of 0.1 mm with melanin over a dermis without end with blood in vessels, 65 % water and a share of bloodless skin's absorption; one
scattering law for both. Total reflectance of a half space tells ratios of coefficients, so the scattering has a prior (measured skin: Jacques 2013,
Shimojo et al. 2020), and so has the slope of melanin. What the model cannot follow is far larger than the noise of the instrument and alike at
neighbouring wavelengths: errors are taken as correlated, and their size and length were laid over the residuals.
"""

import argparse
import csv
import gzip
import time
from pathlib import Path

import equinox as eqx
import numpy as np
from matplotlib.figure import Figure
from record import record

import layerfit as lf

ROOT = Path(__file__).parent.parent
STEP = 4  # every fourth of the 184 wavelengths is fitted, all are judged
STREAMS = 8
INDEPENDENT, RELATIVE, LENGTH = 0.001, 0.012, 40.0  # sd [1], correlated share, and over how many nm it is alike
GEOMETRY = lf.TotalReflectance(incidence=8.0, specular="included")
TIES = {"epidermis.a": "dermis.a", "epidermis.b": "dermis.b"}
SKIN = lf.TissueLayer("epidermis", melanin=0.02, melanin_slope=3.46, a=4.6, b=1.42, g=0.8, n=1.4, thickness=0.1) | lf.TissueHalfSpace(
    "dermis", blood=0.01, saturation=0.6, vessel_radius=0.01, water=0.65, baseline=0.5, a=4.6, b=1.42, g=0.8, n=1.4
)
FREE = {
    "epidermis.melanin": (1e-3, 0.6),
    "epidermis.melanin_slope": {"min": 2.0, "max": 6.0, "prior": lf.Normal(3.46, 0.5)},
    "dermis.blood": (5e-4, 0.2),
    "dermis.saturation": (0.0, 1.0),
    "dermis.vessel_radius": (1e-3, 0.2),
    "dermis.baseline": (0.0, 5.0),
    "dermis.a": {"min": 1.0, "max": 20.0, "prior": lf.LogNormal(4.6, 1.4)},
    "dermis.b": {"min": 0.0, "max": 4.0, "prior": lf.Normal(1.42, 0.5)},
}
COMPARED = ("epidermis.melanin", "dermis.blood", "dermis.a", "dermis.b", "dermis.saturation")


def spectra(folder):
    """Wavelengths [nm] and reflectance factors (people, 3, wavelengths)."""
    with gzip.open(folder / "M38597.csv.gz", "rt", encoding="latin-1") as file:
        rows = list(csv.reader(file))
    first = next(i for i, row in enumerate(rows) if row[0].startswith("Wavelength"))
    columns = [0, *(1 + 4 * person + i for person in range(100) for i in range(3))]
    table = np.array([[float(row[j]) for j in columns] for row in rows[first + 1 :] if row[0].strip()])
    return table[:, 0], table[:, 1:].T.reshape(-1, 3, len(table))


def problem(wavelength, values):
    data = lf.Dataset(lf.Spectrum(wavelength, GEOMETRY), values, np.full(len(values), INDEPENDENT))
    noise = lf.CorrelatedNoise(relative=RELATIVE, length=LENGTH)
    return lf.Problem(SKIN, data, free=FREE, ties=TIES, likelihood=noise, solver=lf.DiscreteOrdinates(streams=STREAMS))


_predict = eqx.filter_jit(lambda model, x: model.predict(x)[0])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "nist-skin")
    parser.add_argument("--people", type=int, default=100)
    arguments = parser.parse_args()
    whole, values = spectra(arguments.data)
    values = values[: arguments.people]
    fitted = (whole >= 450) & (whole <= 1000)
    wavelength = whole[fitted]
    coarse = np.arange(0, wavelength.size, STEP)
    began = time.perf_counter()
    lf.fit(problem(wavelength[coarse], values[0, 0][fitted][coarse]))
    first = time.perf_counter() - began
    began = time.perf_counter()
    fits = [lf.fit(problem(wavelength[coarse], one[fitted][coarse])) for person in values for one in person]
    seconds = time.perf_counter() - began

    flat = values.reshape(-1, whole.size)
    fine = problem(wavelength, flat[0][fitted]).model
    visible = np.arange(400.0, 781.0, 5.0)
    colours = problem(visible, np.interp(visible, whole, flat[0])).model
    x = np.array([fit.x for fit in fits])
    predicted = np.array([np.asarray(_predict(fine, one)) for one in x])
    residual = predicted - flat[:, fitted]
    rms = np.sqrt(np.mean(residual**2, axis=1))
    seen = lf.colour(visible, np.array([np.asarray(_predict(colours, one)) for one in x]))
    delta = seen.delta_e(lf.colour(whole, flat))
    exact = [
        lf.predict(fit.stack, lf.Spectrum(wavelength[::23], GEOMETRY), solver=lf.DiscreteOrdinates(streams=32))[0].values - p[::23]
        for fit, p in list(zip(fits, predicted, strict=True))[::60]
    ]
    scores, bounds = {}, {}
    for name in (p.name for p in fits[0].problem.parameters):
        estimates = [fit.parameters[name] for fit in fits]
        bounds[name] = sum(bool(e.at_bound) for e in estimates)
        value = np.array([e.value for e in estimates]).reshape(-1, 3)
        sd = np.array([np.nan if e.stderr is None else e.stderr for e in estimates]).reshape(-1, 3)
        pairs = [(value[:, i] - value[:, j]) / np.hypot(sd[:, i], sd[:, j]) for i, j in ((0, 1), (0, 2), (1, 2))]
        known = np.concatenate(pairs)
        scores[name] = known[np.isfinite(known)]
    converged = sum(fit.outcome is lf.Outcome.CONVERGED for fit in fits)
    share = {name: float(np.mean(np.abs(scores[name]) <= 2.0)) for name in scores}
    lag = [float(np.mean(residual[:, :-k] * residual[:, k:]) / np.mean(residual**2)) for k in (1, 5, 13, 33)]
    row = {
        "spectra": len(fits),
        "converged": converged,
        "rms_median": float(np.median(rms)),
        "rms_worst": float(np.max(rms)),
        "delta_e_median": float(np.median(delta)),
        "delta_e_worst": float(np.max(delta)),
        "first_s": first,
        "all_s": seconds,
        "streams_error": float(np.max(np.abs(exact))),
        "within_two_sd": share,
        "z_sd": {name: float(np.std(z)) for name, z in scores.items()},
        "at_bound": bounds,
        "residual_correlation_at_3_15_39_99_nm": lag,
    }
    record("nist_skin", [row])
    print(row)
    picture(wavelength, flat[:, fitted], predicted, rms, scores)
    if arguments.people == 100:
        (ROOT / "docs" / "nist-skin.md").write_text(page(row, fits, x))


def picture(wavelength, measured, predicted, rms, scores):
    figure = Figure(figsize=(9.5, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    order = np.argsort(rms)
    for i, label, shade in ((order[0], "best", "#1f4e79"), (order[len(order) // 2], "median", "#2e7d32"), (order[-1], "worst", "#c0392b")):
        left.plot(wavelength[::4], measured[i][::4], "o", ms=2.5, color=shade)
        left.plot(wavelength, predicted[i], "-", lw=1.3, color=shade, label=f"{label}: rms {rms[i]:.4f}")
    left.set(xlabel="wavelength [nm]", ylabel="R", title="measured (points) and fitted (lines)")
    left.legend(frameon=False, fontsize="small")
    bins = np.linspace(-5, 5, 41)
    for name, shade in zip(COMPARED, ("#6d4c41", "#c0392b", "#1f4e79", "#00897b", "#8e44ad"), strict=True):
        right.hist(np.clip(scores[name], -5, 5), bins, histtype="step", density=True, lw=1.3, color=shade, label=name)
    right.plot(bins, np.exp(-0.5 * bins**2) / np.sqrt(2 * np.pi), "k:", lw=1, label="normal")
    right.set(xlabel="difference of two repeats [stated sd of the difference]", ylabel="density", title="repeats of a person")
    right.legend(frameon=False, fontsize="small")
    figure.savefig(ROOT / "docs" / "nist-skin.png", dpi=110)


def page(row, fits, x):
    names = [p.name for p in fits[0].problem.parameters]
    units = [p.unit for p in fits[0].problem.parameters]
    lags = ", ".join(f"{r:.2f}" for r in row["residual_correlation_at_3_15_39_99_nm"])
    text = ["# 300 spectra of human skin", ""]
    text += [part.replace("\n", " ") + "\n" for part in __doc__.strip().split("\n\n")[3:]]
    text += [
        f"Made by `python benchmarks/nist_skin.py`. Work of the US government. {row['converged']} of {row['spectra']} fits converged.",
        "",
        "| what | measured |",
        "|---|---|",
        f"| rms residual of the total reflectance, 184 wavelengths | median {row['rms_median']:.4f}, worst {row['rms_worst']:.4f} |",
        "| Delta E 2000 of fitted against measured (D65, 400 to 780 nm; below 450 nm nothing was fitted) "
        f"| median {row['delta_e_median']:.2f}, worst {row['delta_e_worst']:.2f} |",
        f"| time of all fits with covariance, two cores; the first alone, compilation included | {row['all_s']:.0f} s; {row['first_s']:.0f} s |",
        f"| error of {STREAMS} directions against 32, largest seen | {row['streams_error']:.1e} |",
        f"| correlation of the residuals at 3, 15, 39, 99 nm | {lags} |",
        "",
        "![fits and repeats](nist-skin.png)",
        "",
        "Repeats of a person were taken at other spots of the forearm, so that part of their differences is real. Saturation differs between them "
        "by more than its standard error says: multiply that by the last column.",
        "",
        "| number | median over people | 5 to 95 % | at a bound | differences of repeats within two stated sd | sd of the z-scores |",
        "|---|---|---|---|---|---|",
    ]
    for q, (name, unit) in enumerate(zip(names, units, strict=True)):
        low, middle, high = np.quantile(x[:, q], [0.05, 0.5, 0.95])
        unit = "" if unit == "1" else f" {unit}"
        text.append(
            f"| {name} | {middle:.3g}{unit} | {low:.3g} to {high:.3g} | {row['at_bound'][name]} of {row['spectra']} | "
            f"{100 * row['within_two_sd'][name]:.0f} % | {row['z_sd'][name]:.2f} |"
        )
    return "\n".join(text) + "\n"


if __name__ == "__main__":
    main()
