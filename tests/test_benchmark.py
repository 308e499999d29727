"""The benchmark runs, measures exactly what it says, and reads its own runs."""

import contextlib
import importlib
import io
import json
import pkgutil
from typing import NamedTuple


class Answer(NamedTuple):
    """What a command prints, and its status."""

    returncode: int
    stdout: str
    stderr: str


def run(*arguments: str, module: str = "benchmark.__main__") -> Answer:
    """A command of the benchmark, in this process."""
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        try:
            status = importlib.import_module(module).main(arguments)
        except SystemExit as end:
            status = end.code
    return Answer(status, printed.getvalue(), said.getvalue())


def test_every_part_can_be_imported():
    for found in pkgutil.walk_packages(importlib.import_module("benchmark").__path__, "benchmark."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)


def test_a_run_is_kept_compared_and_written_down(tmp_path):
    kept, page = tmp_path / "run.json", tmp_path / "page.md"
    arguments = ["quality", "--quick", "--instances", "1", "--samples", "30"]
    first = run(*arguments, "--save", str(kept), "--markdown", str(page))
    assert first.returncode == 0, first.stderr
    tables = json.loads(kept.read_text())["tables"]
    assert tables["Gaps, rms error"]["rotator"]["over envelope, %"] > 0.0
    assert all(f"## {title}\n" in page.read_text() for title in tables)
    second = run(*arguments, "--compare", str(kept))
    assert second.returncode == 0, second.stderr
    ratios = second.stdout.partition("Gaps, rms error: new over old")[2].splitlines()
    assert next(line for line in ratios if line.startswith("rotator")).split()[1:] == ["1"] * 5


def reference(*arguments: str) -> Answer:
    return run(*arguments, module="benchmark.reference.__main__")


def test_reference_results_are_recorded_and_compared_to_the_last_bit(tmp_path):
    kept = tmp_path / "reference.json"
    arguments = [str(kept), "--only", "fits,plans", "--every", "60"]
    recorded = reference("record", *arguments)
    assert recorded.returncode == 0, recorded.stderr
    before = json.loads(kept.read_text())["sections"]
    assert [len(before[name]["cases"]) for name in ("fits", "plans")] == [11, 2]
    again = reference("compare", *arguments, "--with", str(kept))
    assert again.returncode == 0, again.stdout
    assert next(line for line in again.stdout.splitlines() if line.startswith("fits"))
    assert "no section nothing" in reference("compare", str(kept), "--only", "nothing").stderr


def test_a_worse_result_fails_the_comparison():
    from benchmark.reference.compare import checks_of, compared

    def run(error, segments, steepest, seconds):
        numbers = {"error": error, "floor": 1e-6, "segments": segments, "steepest": steepest}
        return {"fits": {"pace": 1.0, "cases": {"a": numbers | {"seconds": seconds}}}}

    old = run(1.0, 6, 0.0, 1.0)
    for new, failed in [
        (run(1.0 + 1e-12, 6, 0.0, 1.1), 0),
        (run(1.01, 6, 0.0, 1.0), 3),  # median, mean and share
        (run(1.0, 6, 1e-9, 1.0), 1),
        (run(1.0, 6, 0.0, 1.5), 1),
        ({"fits": {"pace": 1.0, "cases": {"a": {"failed": "ValueError", "seconds": 1.0}}}}, 1),
    ]:
        section = compared(old, new)["fits"]
        assert sum(not check.passed for check in checks_of("fits", section)) == failed
