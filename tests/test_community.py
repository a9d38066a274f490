"""The files for people who take part: issue forms that GitHub accepts, hooks that run, links that lead to a file."""

import re
from pathlib import Path
from pkgutil import iter_modules

import pytest
from ruamel.yaml import YAML

import gmwm
from tests.helpers import tomllib

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "gmwm"
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
PAGES = ("CODE_OF_CONDUCT.md", "CONTRIBUTING.md", "SECURITY.md", ".github/pull_request_template.md")
KINDS = {"markdown", "textarea", "input", "dropdown", "checkboxes"}


def loaded(path: Path) -> dict:
    return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))


def test_there_is_a_form_for_each_kind_of_issue():
    assert [path.stem for path in FORMS] == ["bug_report", "config", "feature_request", "unreadable_file"]


@pytest.mark.parametrize("path", [path for path in FORMS if path.stem != "config"], ids=lambda path: path.stem)
def test_a_form_has_the_keys_that_github_requires(path):
    form = loaded(path)
    assert set(form) == {"name", "description", "labels", "body"}
    fields = [field for field in form["body"] if field["type"] != "markdown"]
    assert {field["type"] for field in form["body"]} <= KINDS
    names = [field["id"] for field in fields]
    assert len(set(names)) == len(names) > 2
    for field in fields:
        assert field["attributes"]["label"], field["id"]
        assert ("options" in field["attributes"]) == (field["type"] in ("dropdown", "checkboxes")), field["id"]
    assert any(field.get("validations", {}).get("required") for field in fields)


def test_hooks_run_the_tools_of_make_lint():
    repositories = loaded(ROOT / ".pre-commit-config.yaml")["repos"]
    hooks = [hook for repository in repositories for hook in repository["hooks"]]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    checks = re.search(r"^lint:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)[1]
    tools = set(re.findall(r"\$\(BIN\)/([\w-]+)", checks)) - {"python"}
    run = {hook.get("entry", hook["id"].partition("-")[0]).split()[0].removeprefix(".venv/bin/") for hook in hooks}
    assert tools <= run
    assert all(repository["repo"] == "local" or re.match(r"v\d", repository["rev"]) for repository in repositories)


@pytest.mark.parametrize("name", PAGES)
def test_links_in_the_files_of_the_root_lead_to_a_file(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if not link.startswith("https:")]
    assert [link for link in links if link and not (ROOT / link).exists()] == []


def test_the_rooms_that_are_described_are_those_that_are_checked():
    section = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Rooms\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.+?) (?<!\\)\| ", section, re.MULTILINE)
    described = [f"gmwm.{room}.{name}" for room, packages in rows for name in re.findall(r"`(\w+)`", packages) or [""]]
    with (ROOT / "pyproject.toml").open("rb") as file:
        (contract,) = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    checked = [name for layer in contract["layers"] for name in re.findall(r"[\w.]+", layer)]
    assert [name.rstrip(".") for name in described] == [name for name in checked if name != "gmwm.__main__"]
    modules = {f"gmwm.{room}.{module.name}" for room in gmwm._ROOMS for module in iter_modules([str(PACKAGE / room)])}
    assert modules <= {*checked, "gmwm.base._core"}
