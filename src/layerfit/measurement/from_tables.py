"""Data from pandas tables and xarray objects, through the same door as files."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from .csv_file import Table, dataset_from_table, geometry_from_table
from .dataset import Dataset, Noise
from .geometry import GEOMETRIES, Total
from .source import Detector, Source
from .spectrum import Spectrum
from .units import NM, factor_to_internal

if TYPE_CHECKING:
    import pandas as pd


def from_pandas(
    frame: "pd.DataFrame",
    kind: str | None = None,
    *,
    units: Mapping[str, str] | None = None,
    source: Source | None = None,
    detector: Detector | None = None,
    noise: Noise | None = None,
    name: str = "measurement",
    **options: Any,
) -> Dataset:
    """A Dataset from a table with the columns of a data file, see `read`.

    frame : columns called as in a file, ``"r [mm]"``, ``"value [1/mm^2]"``, or plainly, with units given apart. A column ``wavelength [nm]`` makes a
    spectrum of a total. units : ``{column: unit}``. The others as for `read`.

    Raises InputError naming the column.

    >>> import layerfit as lf, pandas as pd
    >>> table = pd.DataFrame({"r [cm]": [0.1, 0.2], "value [1/cm^2]": [2.0, 0.8], "sd [1/cm^2]": [0.04, 0.02]})
    >>> lf.from_pandas(table).values
    array([0.02 , 0.008])
    """
    columns, stated = {}, {}
    for heading in frame.columns:
        plain, _, rest = str(heading).partition("[")
        plain = plain.strip()
        unit = rest.removesuffix("]").strip() if rest else (units or {}).get(plain)
        if unit is None:
            raise InputError(f"table: column '{heading}' has no unit; allowed is '{heading} [mm]', or units = {{'{heading}': 'mm'}}")
        try:
            columns[plain], stated[plain] = np.asarray(frame[heading], dtype=float), unit
        except (TypeError, ValueError):
            raise InputError(f"table: column '{heading}' holds something that is not a number") from None
    return _dataset(Table(Path("table"), columns, stated, list(range(1, len(frame) + 1))), kind, source, detector, noise, name, options)


def from_xarray(
    data: Any,
    kind: str | None = None,
    *,
    source: Source | None = None,
    detector: Detector | None = None,
    noise: Noise | None = None,
    name: str | None = None,
    **options: Any,
) -> Dataset:
    """A Dataset from a DataArray of one dimension with a coordinate r, k, fx, angle or wavelength, or from a Dataset with it and ``NAME.sd``.

    Units in the attrs of values and coordinate. name : of the variable, and of the data (default: that of the array, or the only variable).
    The others as for `read`; with a wavelength kind is a total.

    Raises InputError where a unit or a coordinate is missing.

    >>> import layerfit as lf, xarray as xr
    >>> k = xr.DataArray([0.0, 0.2], dims="k", attrs={"units": "rad/mm"})
    >>> seen = xr.DataArray([60.0, 30.0], dims="k", coords={"k": k}, attrs={"units": "%"}, name="camera")
    >>> lf.from_xarray(seen).values
    array([0.6, 0.3])
    """
    import xarray as xr

    if isinstance(data, xr.DataArray):
        data = data.to_dataset(name=name or str(data.name or "measurement"))
    if not isinstance(data, xr.Dataset):
        raise InputError(f"from_xarray: a {type(data).__name__}; allowed is a DataArray or Dataset")
    own = [str(v) for v in data.data_vars if not str(v).endswith(".sd")]
    name = own[0] if name is None and len(own) == 1 else name
    if name not in own:
        raise InputError(f"from_xarray: name = {name!r}; allowed: {', '.join(own)}")
    values = data[name]
    if values.ndim > 1:
        raise InputError(f"from_xarray: '{name}' has the dimensions {', '.join(map(str, values.dims))}; allowed is one (for more: fit_map)")
    found = {"value": values, **({"sd": data[f"{name}.sd"]} if f"{name}.sd" in data else {})}
    found |= {str(dim): data[dim] for dim in values.dims if dim in data.coords}
    found |= {c: data[c] for c in ("r_min", "r_max") if c in data.coords}
    if "r_min" in found:
        found.pop("r", None)
    for column, one in found.items():
        if "units" not in one.attrs:
            inherited = column == "sd" and "units" in values.attrs
            if not inherited:
                raise InputError(f"from_xarray: '{one.name}' has no units; allowed is attrs['units'], such as 'mm'")
            found[column] = one.assign_attrs(units=values.attrs["units"])
    columns = {c: np.atleast_1d(np.asarray(one.values, dtype=float)) for c, one in found.items()}
    table = Table(Path(name), columns, {c: str(one.attrs["units"]) for c, one in found.items()}, list(range(1, values.size + 1)))
    return _dataset(table, kind, source, detector, noise, name, options)


def _dataset(
    table: Table, kind: str | None, source: Source | None, detector: Detector | None, noise: Noise | None, name: str, options: dict[str, Any]
) -> Dataset:
    if kind is not None and kind not in GEOMETRIES:
        raise InputError(f"kind = {kind!r}; allowed: {', '.join(GEOMETRIES)}")
    if "wavelength" in table.columns:
        cls = GEOMETRIES[kind or "total_reflectance"]
        if not issubclass(cls, Total):
            raise InputError(f"{table.path}: wavelengths with kind '{kind}'; allowed with them: total_reflectance, total_transmittance")
        wavelength = table.columns["wavelength"] * NM * factor_to_internal(table.units["wavelength"], "length", f"{table.path}, wavelength")
        geometry: Any = Spectrum(wavelength, cls(**options))
    else:
        geometry = geometry_from_table(table, kind, source=source, detector=detector, **options)
    return dataset_from_table(table, geometry, noise=noise, name=name)
