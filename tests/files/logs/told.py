"""What logs say, for snapshots."""

import math


def told(logs):
    """All that logs say: a line for each, and one of their notes, each once."""
    lines = []
    for log in logs:
        unit, factor = ("deg", 180.0 / math.pi) if log.unit == "rad" else ("of the range", 1.0)
        columns = [1e6 * log.times, factor * log.requests, factor * log.angles]
        columns += [log.torque_on.astype(int)] * (not log.torque_on.all())
        columns += [log.measured.astype(int)] * (not log.measured.all())
        columns += [log.load] * (log.load is not None)
        cells = [" ".join(f"{each:.7g}" for each in values) for values in columns]
        _, _, column, written, scale, shift = log.written
        lines.append(
            f"{log.joint} [{unit}] {'; '.join(cells)}; {column}: {written} {scale:.6g} {shift:.6g}"
        )
    lines.append("; ".join(dict.fromkeys(note for log in logs for note in log.notes)))
    return "".join(f"  {line}\n" for line in lines)
