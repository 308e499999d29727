"""Write tests/approximation/oracle.json: proved optima of seeded instances.

Run it again only if the instances change; it takes some seconds:

    python tests/approximation/make_oracle.py tests/approximation/oracle.json
"""

import json
import sys
from pathlib import Path

from planner import fit_pwl

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.approximation.samples import oracle_instances

if __name__ == "__main__":
    table = [
        {
            "seed": each.seed,
            "rms": fit_pwl(each.desired, **each.settings, segments=each.segments, exact=True).rms,
        }
        for each in oracle_instances()
    ]
    lines = ",\n".join(json.dumps(each) for each in table)
    Path(sys.argv[1]).write_text(f"[\n{lines}\n]\n")
