"""Rows of candidates whose worth is known, in place of plans; light to import."""

from dataclasses import dataclass

from drapeplan.candidates import Candidate
from drapeplan.orders import SequenceSection
from drapeplan.plan_file import CandidateRow


def row(start=(0, 0), **values):
    """A good row, looked at on 64 samples, none of them wrong."""
    known = {"pattern": "all_sides", "why": "a try", "fidelity": "equilibrium"}
    known |= {"good": True, "samples": 64, "low_margin_mm": 3.0, "steps": 4}
    known |= {"penetration_mm": 0.1, "stroke_mm": 100.0, "largest_shear_deg": 1.0}
    known |= {"take_up_left_mm": 0.3, "time_s": 20.0}
    return CandidateRow(start=start, **{**known, **values})


def ways(count):
    """Candidates that start at (0, 0), (0, 1), ..."""
    starts = [(0, k) for k in range(count)]
    return [Candidate(SequenceSection(start=start), "a try") for start in starts]


@dataclass(frozen=True)
class ToyJudge:
    """Says what is known of each candidate, at a glance and at a closer look.

    Attributes:
        glance: Penetration of each kinematic plan in [mm], None where there is none.
        close: Fields of each closer row.
    """

    glance: tuple
    close: tuple = ()

    def __call__(self, question):
        candidate, fidelity, samples = question
        k = candidate.sequence.start[1]
        if self.glance[k] is None:
            values = {"good": False, "refused": "no strokes", "samples": 0}
        elif not samples:
            values = {"penetration_mm": self.glance[k], "samples": 0}
        else:
            values = {"samples": samples, **(self.close[k] if self.close else {})}
        return row((0, k), fidelity=fidelity, **values)
