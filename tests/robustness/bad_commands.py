"""Bad input at the command line: the arguments, and what the one line then says."""

from __future__ import annotations

MODEL = "v_max = 5.0\ntheta_0 = 0.2\nlag = 0.03\nacceleration_time = 0.05\n"
GOOD = "t_s,hip_deg,knee_deg\n0,1,2\n0.008,2,3\n0.016,3,1\n0.024,1,1\n"

FILES = {
    "d.csv": GOOD.encode(),
    "e.csv": GOOD.encode(),
    "empty.csv": b"",
    "names.csv": b"knee_deg\n",
    "text.csv": b"knee_deg\n1\nfast\n2\n",
    "hole.csv": b"hip_deg,knee_deg\n1,2\n3,\n",
    "nan.csv": b"knee_deg\n1\nnan\n",
    "inf.csv": b"knee_deg\n1\n-inf\n",
    "far.csv": b"knee_deg\n1\n1e12\n",
    "ragged.csv": b"hip_deg,knee_deg\n1,2\n3\n",
    "semicolons.csv": b"hip_deg;knee_deg\n1;2\n3;4\n",
    "bytes.csv": b"knee_deg\n1\n\xff\xfe\n",
    "back.csv": b"t_s,knee_deg\n0,1\n-1,2\n-2,3\n",
    "gap.csv": b"t_s,knee_deg\n0,1\n0.008,2\n0.1,3\n",
    "units.csv": b"hip,knee\n1,2\n3,4\n",
    "twice.csv": b"knee_deg,knee_deg\n1,2\n3,4\n",
    "mixed.csv": b"hip_deg,knee_rad\n1,2\n3,4\n",
    "typo.toml": MODEL.replace("lag", "lagg").encode(),
    "short.toml": MODEL.replace("v_max = 5.0\n", "").encode(),
    "text.toml": MODEL.replace("5.0", "'5.0'").encode(),
    "nan.toml": MODEL.replace("5.0", "nan").encode(),
    "negative.toml": MODEL.replace("0.03", "-0.03").encode(),
    "restless.toml": MODEL.replace("5.0", "500.0").encode(),
    "half.toml": MODEL.encode() + b"hold = 0.5\n",
    "held.toml": MODEL.encode() + b"hold = 1000000\n",
    "w.csv": b"a,b\n1,2\n",
    "zero.csv": b"weight\n1\n0\n1\n1\n",
    "one.csv": b"t_s,requested_deg,actual_deg\n0,1,1\n",
    "still.csv": b"t_s,requested_deg,actual_deg\n" + b"".join(b"%d,1,1\n" % k for k in range(200)),
    "repeated.csv": b"t_s,requested_deg,actual_deg\n0,1,1\n0,2,2\n1,3,3\n2,3,3\n",
    "log.csv": b"t_s,requested_deg,actual_deg\n"
    + b"".join(
        b"%.2f,%d,%d\n" % (k / 100, 20 * (k // 30 % 2), 18 * (k // 30 % 2)) for k in range(180)
    ),
    "page.urdf": b"<html></html>",
    "empty.toml": b"",
    "lost.toml": b'[path]\nfile = "no.csv"\n',
}
"""The files that the commands find, beside an empty folder ``folder``."""

BAD = {
    "an unknown option value": (
        ["plan", "d.csv", "--method", "magic"],
        "Invalid value for '--method': 'magic' is not one of 'closed-form', "
        "'optimal', 'foot-optimal'. See 'request-planner plan --help'.",
    ),
    "an unknown norm": (
        ["plan", "d.csv", "--norm", "l7"],
        "Invalid value for '--norm': 'l7' is not one of 'rms', 'max'. See "
        "'request-planner plan --help'.",
    ),
    "an unknown rule": (
        ["plan", "d.csv", "--method", "closed-form", "--rule", "best"],
        "Invalid value for '--rule': 'best' is not one of 'paper', 'exact'. See "
        "'request-planner plan --help'.",
    ),
    "segments that are no number": (
        ["plan", "d.csv", "--method", "closed-form", "--segments", "many"],
        "Invalid value for '--segments': 'many' is not a valid integer. See "
        "'request-planner plan --help'.",
    ),
    "no segments": (
        ["plan", "d.csv", "--method", "closed-form", "--segments", "0"],
        "hip: segments: got 0, expected 2 to 4 for 4 cyclic samples",
    ),
    "more segments than samples": (
        ["plan", "d.csv", "--method", "closed-form", "--segments", "99"],
        "hip: segments: got 99, expected 2 to 4 for 4 cyclic samples",
    ),
    "a joint that is not there": (
        ["plan", "d.csv", "--joint", "ankle"],
        "d.csv, line 1: no column ankle_deg or ankle_rad; columns: t_s, hip_deg, knee_deg",
    ),
    "a tolerance that is no number": (
        ["plan", "d.csv", "--tolerance-deg", "small"],
        "Invalid value for '--tolerance-deg': 'small' is not a valid float. See "
        "'request-planner plan --help'.",
    ),
    "a tolerance of NaN": (
        ["plan", "d.csv", "--tolerance-deg", "nan"],
        "--tolerance-deg: got nan, expected more than 0 degrees. See "
        "'request-planner plan --help'.",
    ),
    "limits without a colon": (
        ["plan", "d.csv", "--limits-deg", "10"],
        "--limits-deg: got '10', expected LOW:HIGH or JOINT=LOW:HIGH in degrees "
        "with LOW below HIGH, such as knee=-27:147. See 'request-planner plan "
        "--help'.",
    ),
    "limits of NaN": (
        ["plan", "d.csv", "--limits-deg", "nan:3"],
        "--limits-deg: got 'nan:3', expected LOW:HIGH or JOINT=LOW:HIGH in degrees "
        "with LOW below HIGH, such as knee=-27:147. See 'request-planner plan "
        "--help'.",
    ),
    "limits beside the path": (
        ["plan", "d.csv", "--limits-deg", "80:90"],
        "hip: desired: sample 0 is 0.0174533 rad, 1.38 rad beyond the angles "
        "1.39626 to 1.5708 rad where the limits on the requests let the joint "
        "rest; clip the trajectory, or widen the limits",
    ),
    "a start of infinity": (
        ["plan", "d.csv", "--no-cyclic", "--start-deg", "inf"],
        "--start-deg: got 'inf', expected DEG or JOINT=DEG, such as knee=30. See "
        "'request-planner plan --help'.",
    ),
    "an empty argument": (
        ["plan", ""],
        "'': is no name of a file; name one, or - for standard input",
    ),
    "an argument too many": (
        ["plan", "d.csv", "e.csv"],
        "Got unexpected extra argument (e.csv) See 'request-planner plan --help'.",
    ),
    "a folder for a file": (
        ["plan", "folder"],
        "folder: cannot be read (is a directory); expected a text file",
    ),
    "an output that is a folder": (
        ["gait", "-o", "folder"],
        "folder: cannot be written (is a directory); choose another place for the output",
    ),
    "an empty output": (
        ["gait", "-o", ""],
        ".: cannot be written (is a directory); choose another place for the output",
    ),
    "an output below a file": (
        ["gait", "-o", "d.csv/a.csv"],
        "d.csv/a.csv: cannot be written (not a directory); choose another place for the output",
    ),
    "an empty file": (
        ["plan", "empty.csv"],
        "empty.csv: empty; expected a line of column names and one row per sample",
    ),
    "names alone": (
        ["plan", "names.csv"],
        "names.csv: rows of samples: got 0, expected at least 2",
    ),
    "a cell of text": (
        ["plan", "text.csv"],
        "text.csv, line 3: column 'knee_deg': got 'fast', expected a finite "
        "number; remove or interpolate the sample",
    ),
    "a cell of nothing": (
        ["plan", "hole.csv"],
        "hole.csv, line 3: column 'knee_deg': got nothing, expected a finite "
        "number; remove or interpolate the sample",
    ),
    "a cell of NaN": (
        ["plan", "nan.csv"],
        "nan.csv, line 3: column 'knee_deg': got 'nan', expected a finite number; "
        "remove or interpolate the sample",
    ),
    "a cell of infinity": (
        ["plan", "inf.csv"],
        "inf.csv, line 3: column 'knee_deg': got '-inf', expected a finite number; "
        "remove or interpolate the sample",
    ),
    "an angle of a million turns": (
        ["plan", "far.csv"],
        "far.csv, line 3: column 'knee_deg': got 1e12, expected at most "
        "5.72958e+07 either way; check the unit",
    ),
    "rows of different lengths": (
        ["plan", "ragged.csv"],
        "ragged.csv, line 3: got 1 cell, expected 2 (hip_deg, knee_deg); is the file cut short?",
    ),
    "semicolons": (
        ["plan", "semicolons.csv"],
        "semicolons.csv, line 1: one column named 'hip_deg;knee_deg', expected "
        "names separated by commas; save the file with commas between columns and "
        "points in numbers",
    ),
    "bytes": (
        ["plan", "bytes.csv"],
        "bytes.csv, line 3: byte 0xff is not UTF-8; save the file as UTF-8 text",
    ),
    "time backwards": (
        ["plan", "back.csv"],
        "back.csv, line 3: t_s is -1 after 0, expected times that increase; sort "
        "the rows and remove doubles",
    ),
    "time with a gap": (
        ["plan", "gap.csv"],
        "gap.csv, line 3: t_s advances by 0.008 s where most steps are 0.05 s, "
        "expected even steps; resample the path at one rate",
    ),
    "columns without units": (
        ["plan", "units.csv"],
        "units.csv, line 1: column 'hip' has no unit; expected hip_deg or hip_rad: "
        "rename it, or remove it",
    ),
    "the same column twice": (
        ["plan", "twice.csv"],
        "twice.csv, line 1: 2 columns are named 'knee_deg', expected one; rename the others",
    ),
    "units mixed": (
        ["plan", "mixed.csv"],
        "mixed.csv, line 1: mixed units (hip_deg, knee_rad); expected one unit in all columns",
    ),
    "a model with a typo": (
        ["simulate", "d.csv", "--model", "typo.toml"],
        "typo.toml, line 3: unknown key 'lagg' (did you mean 'lag'?); keys: v_max, "
        "theta_0, lag, acceleration_time, tick, hold, offset",
    ),
    "a model without speed": (
        ["simulate", "d.csv", "--model", "short.toml"],
        "short.toml: no v_max; expected v_max, theta_0, lag, acceleration_time in rad/s, rad, s, s",
    ),
    "a model of text": (
        ["simulate", "d.csv", "--model", "text.toml"],
        "text.toml: v_max: got '5.0', expected a finite number in SI units",
    ),
    "a model of NaN": (
        ["simulate", "d.csv", "--model", "nan.toml"],
        "nan.toml: v_max: got nan, expected a finite number in SI units",
    ),
    "a model of negative lag": (
        ["simulate", "d.csv", "--model", "negative.toml"],
        "negative.toml: lag: got -0.03 s, expected 0 or more",
    ),
    "a model that cannot rest": (
        ["simulate", "d.csv", "--model", "restless.toml"],
        "restless.toml: v_max * tick: got 4 rad, expected less than 2 theta_0 = "
        "0.4 rad; such a joint would overshoot a constant request for ever: use a "
        "shorter tick (with hold > 1), or check the units",
    ),
    "a model with a hold of half a tick": (
        ["simulate", "d.csv", "--model", "half.toml"],
        "half.toml: hold: got 0.5, expected a whole number of ticks, 1 or more",
    ),
    "a model held for ever": (
        ["simulate", "d.csv", "--model", "held.toml"],
        "held.toml: hold: got 1000000, expected at most 10000 ticks between requests",
    ),
    "a model that is no TOML": (
        ["simulate", "d.csv", "--model", "d.csv"],
        "d.csv, line 1: not TOML: Expected '=' after a key in a key/value pair at "
        "column 4; expected lines such as 'v_max = 5.45', and 0.1 for .1",
    ),
    "fit without a joint": (
        ["fit"],
        "Missing argument 'DESIRED'. See 'request-planner fit --help'.",
    ),
    "fit with two sizes": (
        ["fit", "d.csv", "--max-error", "1", "--max-rms", "1"],
        "hip: max_error, max_rms: got both, expected one; leave one away",
    ),
    "fit with a knot outside": (
        ["fit", "d.csv", "--knot-s", "9"],
        "hip: knots: got a knot at 1125, expected 0 up to, without, 4 [samples]",
    ),
    "fit with a required knot of text": (
        ["fit", "d.csv", "--required-s", "now"],
        "--required-s: got 'now', expected seconds (0.4) or seconds=degrees "
        "(0.4=12.5). See 'request-planner fit --help'.",
    ),
    "fit with weights of nobody": (
        ["fit", "d.csv", "--weights", "w.csv"],
        "w.csv: rows of samples: got 1, expected at least 2",
    ),
    "fit with weights of zero": (
        ["fit", "d.csv", "--weights", "zero.csv"],
        "hip: weights: got 0 at sample 1, expected more than 0",
    ),
    "fit with the end of a cycle": (
        ["fit", "d.csv", "--end-deg", "3"],
        "--end-deg: a cycle has no ends; add --no-cyclic. See 'request-planner fit --help'.",
    ),
    "fit exactly for an error": (
        ["fit", "d.csv", "--exact", "--max-error", "1"],
        "hip: exact: expected segments or max_rms with it; give one of them",
    ),
    "a log without requests": (
        ["identify", "d.csv"],
        "d.csv, line 1: no column names a requested or an actual angle; columns: "
        "t_s, hip_deg, knee_deg; name them with --requested and --actual",
    ),
    "a log of one row": (
        ["identify", "one.csv"],
        "one.csv: rows of samples: got 1, expected at least 2",
    ),
    "a log that never moves": (
        ["identify", "-q", "still.csv"],
        "the requests never change in this log: record one in which they move the joint",
    ),
    "a log with a time twice": (
        ["identify", "repeated.csv"],
        "repeated.csv, line 3: time is 0 s after 0 s, expected times that "
        "increase; sort the rows and remove doubles",
    ),
    "a log in another unit": (
        ["identify", "log.csv", "--unit", "yards"],
        "unit 'yards' is unknown; expected one of rad, deg, ticks, turns, range, "
        "percent, range_m100_100, or rad,Jaw=range where joints differ",
    ),
    "a tick of nothing": (
        ["identify", "-q", "log.csv", "--tick-ms", "0"],
        "--tick-ms: got 0, expected more than 0 milliseconds. See 'request-planner "
        "identify --help'.",
    ),
    "a hold of nothing": (
        ["identify", "log.csv", "--hold", "0"],
        "Invalid value for '--hold': 0 is not in the range x>=1. See "
        "'request-planner identify --help'.",
    ),
    "no such column of a log": (
        ["identify", "log.csv", "--requested", "wanted"],
        "log.csv, line 1: no column 'wanted'; columns: t_s, requested_deg, actual_deg",
    ),
    "an export of no format": (
        ["export", "d.csv", "-o", "a.csv"],
        "Missing option '--format'. Choose from: csv, yaml, bag, mcap, lerobot See "
        "'request-planner export --help'.",
    ),
    "an export at no rate": (
        ["export", "d.csv", "--format", "csv", "--rate-hz", "0", "-o", "a.csv"],
        "rate: got 0 Hz, expected a positive number",
    ),
    "an export never": (
        ["export", "d.csv", "--format", "csv", "--cycles", "0", "-o", "a.csv"],
        "cycles: got 0, expected a whole number from 1 up",
    ),
    "an export with too few names": (
        ["export", "d.csv", "--format", "csv", "--joint-names", "a", "-o", "a.csv"],
        "joint names: got a, expected 2 different names, one per column of the requests",
    ),
    "an export of names twice": (
        ["export", "d.csv", "--format", "csv", "--joint-names", "a,a", "-o", "a.csv"],
        "joint names: got a, a, expected 2 different names, one per column of the requests",
    ),
    "an excitation of no range": (
        ["excite", "--limits-deg", "9", "-9"],
        "limits: got 0.15708 to -0.15708 rad, expected the lower one first",
    ),
    "an excitation of NaN": (
        ["excite", "--limits-deg", "nan", "9"],
        "limits: got nan to 0.15708 rad, expected the lower one first",
    ),
    "an excitation of no kind": (
        ["excite", "--limits-deg", "-9", "9", "--kind", "noise"],
        "Invalid value for '--kind': 'noise' is not one of 'steps', 'multisine', "
        "'chirp', 'random-steps', 'triangle'. See 'request-planner excite --help'.",
    ),
    "a seed below zero": (
        ["excite", "--limits-deg", "-9", "9", "--seed", "-1"],
        "Invalid value for '--seed': -1 is not in the range x>=0. See "
        "'request-planner excite --help'.",
    ),
    "a leg without a file": (
        ["gait", "--leg", "no.urdf", "--base", "a", "--foot", "b"],
        "no.urdf: cannot be read (No such file or directory); expected a URDF file",
    ),
    "a leg of no robot": (
        ["gait", "--leg", "d.csv", "--base", "a", "--foot", "b"],
        "Invalid value for '--leg': 'd.csv' is not one of 'reference', "
        "'front-left', 'front-right', 'hind-left', 'hind-right', nor a .urdf file. "
        "See 'request-planner gait --help'.",
    ),
    "a leg of another XML": (
        ["gait", "--leg", "page.urdf", "--base", "a", "--foot", "b"],
        "page.urdf: the root element is <html>, expected <robot>",
    ),
    "a ground fraction of one": (
        ["gait", "--ground-fraction", "1"],
        "ground_fraction: got 1.0, expected a finite number above 0 and below 1",
    ),
    "a stroke of NaN": (
        ["gait", "--length", "nan"],
        "length: got nan, expected a finite number above 0",
    ),
    "a run of nothing": (
        ["run"],
        "name a run file, or begin one with --template. See 'request-planner run --help'.",
    ),
    "a run file that is not there": (
        ["run", "no.toml"],
        "no.toml: no such file; check the name and the folder",
    ),
    "a run file that is empty": (
        ["run", "empty.toml"],
        "empty.toml: path: nothing to follow, expected file or [path.half_ellipse]",
    ),
    "a run that reads nothing": (
        ["run", "lost.toml"],
        "no.csv: no such file; check the name and the folder",
    ),
    "a reproduction into a file": (
        ["reproduce", "--out", "d.csv"],
        "d.csv: is a file, expected a folder; choose another name",
    ),
    "a view of nothing": (
        ["view", "no.csv", "--leg", "reference"],
        "no.csv: no such file; check the name and the folder",
    ),
    "a knot at no time": (
        ["fit", "d.csv", "--knot-s", "nan"],
        "hip: knots: 1 of 1 samples are not finite, the first at index 0 (nan); remove or "
        "interpolate them first",
    ),
    "a knot at the end of time": (
        ["fit", "d.csv", "--knot-s", "1e400"],
        "hip: knots: 1 of 1 samples are not finite, the first at index 0 (inf); remove or "
        "interpolate them first",
    ),
    "cycles beyond counting": (
        ["export", "d.csv", "--format", "csv", "--cycles", "1" + "0" * 400],
        "so many cycles make too many rows, expected at most 1000000; ask for fewer cycles",
    ),
    "ticks beyond counting": (
        ["export", "d.csv", "--format", "csv", "--unit", "ticks", "--ticks-per-turn", "1" * 400],
        "ticks per turn: got a very large number, expected 2 to 2147483648",
    ),
    "a sensor finer than atoms": (
        ["excite", "--limits-deg", "-9", "9", "--resolution-deg", "1e-320"],
        "--resolution-deg: got 9.99989e-321, expected 0 for none, or at least 1e-09. See "
        "'request-planner excite --help'.",
    ),
    "a word that colours the terminal": (
        ["plan", "d.csv", "--method", "\x1b[31mred"],
        "Invalid value for '--method': '\\x1b[31mred' is not one of 'closed-form', 'optimal', "
        "'foot-optimal'. See 'request-planner plan --help'.",
    ),
    "a command that writes from right to left": (
        ["\u202enalp"],
        "No such command '\\u202enalp'. See 'request-planner --help'.",
    ),
    "a word without end": (
        ["plan", "d.csv", "--norm", "x" * 5000],
        f"Invalid value for '--norm': '{'x' * 1171} … {'x' * 236}' is not one of 'rms', 'max'. See "
        "'request-planner plan --help'.",
    ),
    "a log into a folder": (
        ["excite", "--limits-deg", "-9", "9", "--expected-log", "folder"],
        "folder: cannot be written (is a directory); choose another place for the output",
    ),
}
