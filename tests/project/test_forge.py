# SPDX-License-Identifier: BSD-2-Clause
"""Files for a forge and for conda: what they call exists, and they say what the project says."""

from importlib.util import find_spec
from pathlib import Path

import jinja2
import pytest
import yaml

import sst_pin

ROOT = Path(__file__).resolve().parents[2]


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def runs(path):
    """Commands of the steps of a workflow."""
    jobs = read(path)["jobs"].values()
    return [step["run"] for job in jobs for step in job["steps"] if "run" in step]


def test_the_workflow_of_checks_calls_ci_and_nothing_else():
    assert runs(".github/workflows/checks.yml") == [".ci/run"]
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o100


def test_wheels_are_built_for_each_system_that_is_configured():
    assert any("cibuildwheel --output-dir" in run for run in runs(".github/workflows/wheels.yml"))
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (build,) = read(".github/workflows/wheels.yml")["jobs"].values()
    for system in {name.split("-")[0] for name in build["strategy"]["matrix"]["os"]}:
        name = {"ubuntu": "linux", "macos": "macos"}[system]
        assert f"[tool.cibuildwheel.{name}]" in text


def test_pre_commit_has_the_linters_of_ci():
    (local,) = read(".pre-commit-config.yaml")["repos"]
    called = {hook["entry"].removesuffix(" --force-exclude") for hook in local["hooks"]}
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    run = [x.removeprefix(".venv/bin/").removesuffix(" .").removesuffix(" --check") for x in lines]
    assert called == {x for x in run if x.startswith(("ruff", "mypy", "lint-imports"))}


def test_a_problem_comes_with_robot_versions_and_what_was_expected():
    form = read(".github/ISSUE_TEMPLATE/problem.yml")["body"]
    needed = {field["id"] for field in form if field["validations"]["required"]}
    assert needed == {"happened", "expected", "robot", "versions"}


@pytest.fixture(scope="module")
def recipe():
    """The recipe, rendered as conda-build does."""
    text = (ROOT / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    strict = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False)
    known = {
        "compiler": lambda language: f"{language}-compiler",
        "stdlib": lambda language: f"{language}-stdlib",
        "PYTHON": "python",
    }
    return yaml.safe_load(strict.from_string(text).render(known))


@pytest.fixture(scope="module")
def project():
    tomllib = pytest.importorskip("tomllib")  # since Python 3.11
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def pinned(requirements):
    return {line.replace(" ", "") for line in requirements}


def test_recipe_has_name_version_licence_and_command_of_the_project(recipe, project):
    own = project["project"]
    assert recipe["package"] == {"name": own["name"], "version": sst_pin.__version__}
    assert recipe["about"]["summary"] == own["description"]
    assert recipe["about"]["license"] == own["license"]
    assert (ROOT / recipe["about"]["license_file"]).is_file()
    commands = [f"{name} = {function}" for name, function in own["scripts"].items()]
    assert recipe["build"]["entry_points"] == commands


def test_recipe_asks_for_the_dependencies_of_the_project(recipe, project):
    own, needs = project["project"], recipe["requirements"]
    run = {line.replace("pinocchio", "pin") for line in pinned(needs["run"])}
    assert run == pinned(own["dependencies"]) | {"python" + own["requires-python"]}
    assert pinned(needs["host"]) == pinned(project["build-system"]["requires"]) | {"python", "pip"}
    assert needs["build"] == ["c-compiler", "c-stdlib"]


def test_recipe_builds_what_lies_around_it_for_each_platform(recipe):
    assert recipe["source"] == {"path": ".."}
    assert "noarch" not in recipe["build"]
    assert all(find_spec(name) for name in recipe["test"]["imports"])
