"""What data could tell, as text."""

import math
from typing import TYPE_CHECKING, Any

from ..inference.uncertainty import POOR, UNDETERMINED, is_positive
from .tables import aligned, unit_text

if TYPE_CHECKING:
    from ..inference.design import Step
    from ..inference.identify import Identification, Knowledge


def share_text(relative: float, positive: bool = True) -> str:
    """A relative standard deviation: 3.4 %; in units of the interval where the number is not positive by nature."""
    if not math.isfinite(relative):
        return "open"
    percent = f"{100 * relative:.2g} %" if relative < 0.995 else "100 %"
    size = percent if relative < 1 else f"x {math.exp(relative):.2g}" if relative < 5 and positive else "open"
    return size if positive else f"{size} of bounds"


def verdict(relative: float) -> str:
    """In one or two words."""
    return "not determined" if not relative <= UNDETERMINED else "poorly" if relative > POOR else ""


def _rows(knowledge: "Knowledge") -> dict[str, tuple[str, ...]]:
    return {
        p.name: (f"{x:.4g}", unit_text(p.unit), f"{sd:.2g}" if math.isfinite(sd) else "open", share_text(share, is_positive(p)), verdict(share))
        for p, x, sd, share in zip(knowledge.parameters, knowledge.x.tolist(), knowledge.sd.tolist(), knowledge.relative.tolist(), strict=True)
    }


def _steps(found: "Identification", steps: "tuple[Step, ...]") -> list[str]:
    names = found.problem.names
    cells: list[Any] = [("", "measurement", "where", "bits", *names)]
    for number, step in enumerate(steps, 1):
        shares = [share_text(s, is_positive(p)) for s, p in zip(step.relative.tolist(), found.problem.parameters, strict=True)]
        cells.append((str(number), step.measurement, step.place, f"{step.bits:.1f}", *shares))
    return [f"  {line}" for line in aligned(cells, left=(1, 2))]


def identification_text(found: "Identification") -> str:
    """A table of bounds, absolute and relative, what is left open in words, and what would tell most."""
    problem = found.problem
    count = sum(d.geometry.size for d in problem.data)
    lines = [f"what {count} value{'s' if count > 1 else ''} could tell: Cramer-Rao bounds, solver {problem.chosen.name}"]
    both = [("absolute", found.absolute)] + ([("relative", found.relative)] if found.relative is not None else [])
    tables = [_rows(knowledge) for _, knowledge in both]
    head = ["number", "value", "unit"] + [text for name, _ in both for text in (f"sd, {name} data", "", "")]
    cells: list[tuple[str, ...]] = [tuple(head)]
    for name in dict.fromkeys(name for table in tables[::-1] for name in table):
        known = [table.get(name) for table in tables]
        first = next(row for row in known if row is not None)
        cells.append((name, *first[:2], *(text for row in known for text in (row[2:] if row is not None else ("", "held", "")))))
    left = (0, 2, 5, 8)
    lines += [f"  {line}" for line in aligned(cells, left=left)]
    for name, knowledge in both:
        said = f"{name} data{' (the amplitude of each profile free)' if name == 'relative' else ''}{', as asked' if name == found.stated else ''}"
        lines.append(f"{said}: " + ("every number is determined" if not knowledge.sentences else ""))
        lines += [f"  ! {sentence}" for sentence in knowledge.sentences]
    if found.places:
        lines += ["of the given values these tell most, in this order (sd left after each, the bounds known before):", *_steps(found, found.places)]
    if found.extra:
        lines += ["besides all of them these would tell most, one after the other:", *_steps(found, found.extra)]
    return "\n".join(line.rstrip() for line in lines)
