"""What is released: the files of wheel and sdist, and one version and date wherever they stand."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

from planner._version import __version__
from planner.files.joint_model import read_model_file

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PACKAGES = ("kinematics", "planner", "urdf")

BESIDE = (
    *(".ci", "docs", "examples", "lerobot_robot_planned", "scripts", "tests"),
    *(".gitignore", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "PKG-INFO"),
    *("README.md", "pyproject.toml"),
)

KINDS = {
    *("", ".cff", ".css", ".csv", ".html", ".ipynb", ".js", ".json", ".md", ".mplstyle", ".py"),
    *(".pyi", ".svg", ".toml", ".txt", ".typed", ".urdf"),
}

README = (ROOT / "README.md").read_text(encoding="utf-8")


def _sources():
    """Every file of the packages that is to be in a wheel: all but what tools left there."""
    return {
        file.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for file in (ROOT / package).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
        if not any(part.startswith(".") for part in file.relative_to(ROOT).parts)
    }


@pytest.fixture
def build(tmp_path, monkeypatch):
    """The build of the project, and the folder it is to go to; asks for no network."""
    build = pytest.importorskip("hatchling.build", reason="needs hatchling, of the extra dev")
    monkeypatch.chdir(ROOT)
    return build, tmp_path


def test_a_wheel_holds_every_file_of_the_packages_and_nothing_else(build):
    hatchling, folder = build
    with zipfile.ZipFile(folder / hatchling.build_wheel(str(folder))) as wheel:
        names = set(wheel.namelist())
    described = {name for name in names if ".dist-info/" in name}
    assert names - described == _sources()
    assert {"METADATA", "RECORD", "WHEEL", "entry_points.txt", "LICENSE"} == {
        Path(name).name for name in described
    }


def test_an_sdist_holds_the_packages_and_all_that_is_needed_to_test_them(build):
    hatchling, folder = build
    with tarfile.open(folder / hatchling.build_sdist(str(folder))) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    assert _sources() <= names
    assert {name.partition("/")[0] for name in names} == {*PACKAGES, *BESIDE}
    tests = {file.relative_to(ROOT).as_posix() for file in (ROOT / "tests").rglob("*.py")}
    assert tests <= names
    assert {Path(name).suffix for name in names if "/" in name} <= KINDS


def test_changelog_and_citation_tell_the_version_and_its_date():
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    released = next(heading for heading in headings if heading != "[Unreleased]")
    assert released == f"[{CITATION['version']}] - {CITATION['date-released']}"
    assert CITATION["version"] == __version__


def test_the_scripts_look_for_the_pythons_that_the_metadata_names():
    named = [
        found[1]
        for line in PROJECT["classifiers"]
        if (found := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))
    ]
    assert PROJECT["requires-python"] == f">={named[0]}"
    scripts = (ROOT / "scripts" / "_venv").read_text(encoding="utf-8")
    listed = re.search(r"^supported=\((.*)\)$", scripts, re.MULTILINE)
    assert listed is not None
    assert listed[1].split() == [f"python{version}" for version in reversed(named)]


def test_the_extra_for_developers_has_what_the_others_need_in_the_same_versions():
    extras = PROJECT["optional-dependencies"]
    inside = {*extras["dev"]}
    for extra in ("parquet", "bags", "mujoco", "meshcat", "yaml", "cluster", "sweep"):
        assert set(extras[extra]) <= inside, extra


USED_BY_THE_PLUGIN = """
import sys
sys.modules |= dict.fromkeys(sys.argv[1:])
import numpy as np
import planner
from planner.robot import arm, bus
from planner.virtual.servo_bus import VirtualServos
VirtualServos(1).run(0.01)
joint = planner.JointModel(v_max=5.0, theta_0=0.3, lag=0.02, acceleration_time=0.04, tick=0.02)
random = np.random.default_rng(0)
steps = np.repeat(random.uniform(-0.5, 0.5, 12), 25)
angles = planner.simulate(joint, steps, cyclic=False) + random.normal(scale=0.01, size=300)
model = planner.identify((0.02 * np.arange(300), steps, angles)).model
model.to_toml("arm.toml")
planner.Stream([*planner.read_models("arm.toml").values()], preview=25).step(angles[:, np.newaxis])
"""


def test_scripts_lerobot_installs_what_the_tests_of_the_plugin_use(tmp_path):
    """What it does not install of our dependencies is missing here, too."""
    installed = (ROOT / "scripts" / "lerobot").read_text(encoding="utf-8")
    names = (re.match(r"[\w-]+", each)[0] for each in PROJECT["dependencies"])
    missing = [name for name in names if not re.search(rf"\b{name}\b", installed)]
    modules = ["pinocchio" if name == "pin" else name for name in missing]
    code = [sys.executable, "-P", "-c", USED_BY_THE_PLUGIN, *modules]
    done = subprocess.run(code, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_model_file_of_the_readme_is_one_and_the_files_that_it_names_are_there(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])
    hip, knee = read_model_file(file).for_joints(["hip", "knee"])
    assert (hip.lag, knee.lag) == pytest.approx((0.032, 0.040))
    for name in re.findall(r"\]\((\w[\w/.]*)\)|`(\w+/\w+\.md|[A-Z]+\.md)`", README):
        assert (ROOT / (name[0] or name[1])).is_file(), name
