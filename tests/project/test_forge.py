# SPDX-License-Identifier: BSD-2-Clause
"""The recipe for conda says what the project says."""

import jinja2
import pytest
import yaml

import sst_pin
from tests.support.files import ROOT


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
    metadata = project["project"]
    assert recipe["package"] == {"name": metadata["name"], "version": sst_pin.__version__}
    assert recipe["about"]["summary"] == metadata["description"]
    assert recipe["about"]["license"] == metadata["license"]
    assert (ROOT / recipe["about"]["license_file"]).is_file()
    commands = [f"{name} = {function}" for name, function in metadata["scripts"].items()]
    assert recipe["build"]["entry_points"] == commands


def test_recipe_asks_for_the_dependencies_of_the_project(recipe, project):
    metadata, needs = project["project"], recipe["requirements"]
    run = {line.replace("pinocchio", "pin") for line in pinned(needs["run"])}
    assert run == pinned(metadata["dependencies"]) | {"python" + metadata["requires-python"]}
    assert pinned(needs["host"]) == pinned(project["build-system"]["requires"]) | {"python", "pip"}
    assert needs["build"] == ["c-compiler", "c-stdlib"]
