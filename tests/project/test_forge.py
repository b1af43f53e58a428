# SPDX-License-Identifier: BSD-2-Clause
"""Files for a forge: what they call exists, and pre-commit runs the linters that CI runs."""

from pathlib import Path

import yaml

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
    linters = [
        x.removeprefix(".venv/bin/")
        for x in lines
        if x.startswith((".venv/bin/ruff", ".venv/bin/mypy"))
    ]
    assert called == {x.removesuffix(" .").removesuffix(" --check") for x in linters}


def test_a_problem_comes_with_robot_versions_and_what_was_expected():
    form = read(".github/ISSUE_TEMPLATE/problem.yml")["body"]
    needed = {field["id"] for field in form if field["validations"]["required"]}
    assert needed == {"happened", "expected", "robot", "versions"}
