"""Rows of the stored profiles of this folder."""


def ring_rows(label, edges, found):
    """``label,r_min,r_max,value,se`` of each ring between edges [mm] of a Monte Carlo prediction [1/mm^2]."""
    assert found.estimated_error is not None
    rows = zip(edges[:-1], edges[1:], found.values, found.estimated_error, strict=True)
    return [f"{label},{low:.6g},{high:.6g},{value:.6g},{error:.3g}" for low, high, value, error in rows]
