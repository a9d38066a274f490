"""What is passed on: the source archive, the wheel's promise to run on any processor, and the workflows."""

import json
import re
import shutil
import tarfile
import zipfile
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from gmwm.base import _core
from release import __main__ as release
from release import site
from tests.helpers import tomllib

ROOT = Path(__file__).resolve().parent.parent
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
RECIPE = ROOT / "release" / "conda" / "recipe.yaml"
LARGEST = 2_000_000
"""Bytes of the source archive: 0.4 MB are the plotting script of the HTML report, and 1.5 MB the source. Tests or the
documentation would add several MB."""


def parsed(path: Path) -> dict:
    return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))


def steps(path: Path) -> list[dict]:
    return [step for job in parsed(path)["jobs"].values() for step in job["steps"]]


def described() -> dict:
    with (ROOT / "pyproject.toml").open("rb") as file:
        return tomllib.load(file)


# --- the archive and the wheel ------------------------------------------------------------------------


@pytest.mark.slow
def test_the_source_archive_is_whole_and_small(tmp_path, monkeypatch):
    from scikit_build_core.build import build_sdist

    monkeypatch.chdir(ROOT)
    archive = tmp_path / build_sdist(str(tmp_path))
    release.look_into_archive(archive)
    assert archive.stat().st_size < LARGEST
    with tarfile.open(archive) as files:
        packed = {name.partition("/")[2] for name in files.getnames()}
    missing = [str(file.relative_to(ROOT)) for file in (ROOT / "src").rglob("*.py")]
    missing += [str(file.relative_to(ROOT)) for file in (ROOT / "cpp").rglob("*.[ch]pp")]
    assert sorted(set(missing) - packed) == []
    # Its commands need what stays in the repository.
    assert "Makefile" not in packed


@pytest.mark.slow
@pytest.mark.parametrize("surplus", ["tests/test_house.py", "docs/index.md", ".venv/pyvenv.cfg"])
def test_an_archive_with_tests_is_refused(tmp_path, surplus):
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as files:
        for name in ("LICENSE", "README.md", "CMakeLists.txt", "pyproject.toml"):
            files.add(ROOT / name, f"gmwm-1/{name}")
        for name in ("cpp/bind/module.cpp", "src/gmwm/py.typed"):
            files.add(ROOT / name, f"gmwm-1/{name}")
        for ending in ("min.js", "LICENSE"):
            name = f"src/{release.VENDORED}.{ending}"
            files.add(ROOT / name, f"gmwm-1/{name}")
    release.look_into_archive(tmp_path / "a.tar.gz")
    with tarfile.open(tmp_path / "b.tar.gz", "w:gz") as files:
        with tarfile.open(tmp_path / "a.tar.gz") as others:
            for member in others.getmembers():
                files.addfile(member, others.extractfile(member))
        files.add(ROOT / "LICENSE", f"gmwm-1/{surplus}")
    with pytest.raises(release.ReleaseError, match=re.escape(surplus)):
        release.look_into_archive(tmp_path / "b.tar.gz")


def wheel(path: Path, *left_out: str, more: tuple[str, ...] = ()) -> Path:
    names = ["gmwm/base/_core.abi3.so", f"{release.VENDORED}.min.js", "gmwm-1.dist-info/METADATA"]
    names += ["gmwm-1.dist-info/licenses/", "gmwm-1.dist-info/licenses/LICENSE"]
    names += [f"gmwm-1.dist-info/licenses/src/{release.VENDORED}.LICENSE", *more]
    with zipfile.ZipFile(path, "w") as files:
        for name in names:
            if name not in left_out:
                files.writestr(name, "")
    return path


@pytest.mark.parametrize(
    "left_out",
    [
        "gmwm/base/_core.abi3.so",
        f"{release.VENDORED}.min.js",
        "gmwm-1.dist-info/licenses/LICENSE",
        f"gmwm-1.dist-info/licenses/src/{release.VENDORED}.LICENSE",
    ],
)
def test_a_wheel_without_kernels_or_licences_is_refused(tmp_path, left_out):
    release.look_into_wheel(wheel(tmp_path / "whole.whl"))
    with pytest.raises(release.ReleaseError):
        release.look_into_wheel(wheel(tmp_path / "not.whl", left_out))


def test_a_wheel_that_installs_tests_is_refused(tmp_path):
    with pytest.raises(release.ReleaseError, match="tests"):
        release.look_into_wheel(wheel(tmp_path / "not.whl", more=("tests/test_house.py",)))


def test_a_compiler_on_the_path_is_refused(tmp_path):
    assert release.bare(tmp_path)["PATH"] == str(tmp_path)
    (tmp_path / "g++").touch(mode=0o755)
    with pytest.raises(release.ReleaseError, match=r"g\+\+"):
        release.bare(tmp_path)


@pytest.mark.parametrize("glibc", [None, "2.28"])
def test_a_wheel_for_an_older_glibc_is_built_with_zig(tmp_path, monkeypatch, glibc):
    calls = []

    def stand_in(*command, environment=None, **_):
        calls.append((" ".join(map(str, command)), environment or {}))
        (tmp_path / "gmwm.tar.gz").touch()
        (tmp_path / "gmwm-manylinux.whl").touch()

    monkeypatch.setattr(release, "run", stand_in)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("CXX", raising=False)
    release.build(tmp_path, glibc)
    release.repair(tmp_path / "gmwm-manylinux.whl", tmp_path, glibc)
    (_, built), (repaired, _) = calls
    assert ("-linux-gnu.2.28" in built.get("CXX", "")) == (glibc is not None)
    assert ("--plat manylinux_2_28_" in repaired) == (glibc is not None)


def test_nothing_is_built_for_this_processor_alone():
    text = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    assert "-O3" in text
    assert re.findall(r"-m(?:arch|tune|cpu|avx|fma|sse)\S*|/arch:\S*|native", text) == []
    assert _core.clone() in {"x86-64-v3", "x86-64-v4", "portable"}


def test_the_group_of_development_tools_is_the_extra():
    extra = described()["project"]["optional-dependencies"]["dev"]
    assert {"pytest", "ruff", "mypy"} <= {re.split(r"[<>=]", requirement)[0] for requirement in extra}
    assert described()["dependency-groups"]["dev"] == ["gmwm[dev]"]


# --- descriptions for other archives ------------------------------------------------------------------


def test_every_description_states_the_same_version_and_words():
    project = described()["project"]
    citation = YAML(typ="safe", pure=True).load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert citation["version"] == project["version"] == parsed(RECIPE)["context"]["version"]
    assert zenodo["license"] == citation["license"] == project["license"]
    assert zenodo["keywords"] == citation["keywords"]
    assert [one["identifier"] for one in zenodo["related_identifiers"]] == [
        one["value"] for one in citation["preferred-citation"]["identifiers"]
    ]


def test_the_conda_recipe_needs_what_the_package_needs():
    stated = parsed(RECIPE)["requirements"]
    run = [one if isinstance(one, str) else one["then"] for one in stated["run"] if one != "python"]
    needed = {re.sub(r"[-_]base$", "", name) + least for name, least in map(str.split, run)}
    project = described()["project"]
    # A conda package has no extras. It draws plots and reads the recordings of ROS.
    extras = project["optional-dependencies"]
    pip = [*project["dependencies"], *extras["plots"], *extras["ros"]]
    assert needed == {re.sub(r";.*", "", requirement) for requirement in pip}
    conditions = {entry["then"].replace(" ", ""): entry["if"] for entry in stated["run"] if not isinstance(entry, str)}
    marked = [entry.split(";") for entry in described()["project"]["dependencies"] if ";" in entry]
    assert conditions == {
        package: f'match(python, "<{re.fullmatch(r" python_version < .([0-9.]+).", marker)[1]}")'
        for package, marker in marked
    }
    host = {one.replace(" ", "") for one in stated["host"]} - {"python", "pip"}
    assert host == set(described()["build-system"]["requires"])
    assert parsed(RECIPE)["build"]["skip"] == f'match(python, "<{described()["project"]["requires-python"][2:]}")'


def test_the_conda_recipe_is_rendered_for_each_python():
    rattler = pytest.importorskip("rattler_build", reason="needs rattler-build: pip install py-rattler-build")
    tools = {"cxx_compiler": ["gxx"], "c_stdlib": ["sysroot"]}
    versions = {"python": ["3.11.*", "3.14.*"]}
    rendered = rattler.Stage0Recipe.from_file(str(RECIPE)).render(rattler.VariantConfig({**versions, **tools}))
    runs = [json.dumps(one.recipe.to_dict()["requirements"]["run"]) for one in rendered]
    assert ["backports.zstd" in run for run in runs] == [True, False]


# --- the workflows ------------------------------------------------------------------------------------


def test_workflows_are_there():
    assert [path.stem for path in WORKFLOWS] == ["ci", "docs", "wheels"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_may_do_little_and_pin_what_they_use(path):
    content = parsed(path)
    assert content["permissions"] == {"contents": "read"}
    writes = {
        name: set(job["permissions"]) for name, job in content["jobs"].items() if "write" in str(job.get("permissions"))
    }
    needed = {"docs": {"publish": {"pages", "id-token"}}, "wheels": {"publish": {"id-token"}}}
    assert writes == needed.get(path.stem, {})
    assert all("timeout-minutes" in job for job in content["jobs"].values())
    used = [step["uses"] for step in steps(path) if "uses" in step]
    assert used
    # A tag can be moved to other code, a commit cannot.
    assert [name for name in used if not re.search(r"@[0-9a-f]{40}$", name)] == []
    text = path.read_text(encoding="utf-8")
    assert len(re.findall(r"uses: \S+@[0-9a-f]{40} # v\d+\.\d+\.\d+\n", text)) == len(used)
    assert "secrets." not in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_call_targets_that_exist(path):
    targets = re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    commands = [step["run"].split() for step in steps(path) if "run" in step]
    made = {words[1] for words in commands if words[0] == "make"}
    assert made
    assert made <= set(targets)


def test_the_same_versions_are_tested_and_built():
    tested = parsed(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]["test"]["strategy"]["matrix"]["python"]
    build = described()["tool"]["cibuildwheel"]["build"].split()
    assert build == [f"cp{version.replace('.', '')}-*" for version in tested]
    assert described()["project"]["requires-python"] == f">={tested[0]}"
    # The version from which on one wheel serves all later ones is built itself.
    assert described()["tool"]["scikit-build"]["wheel"]["py-api"] + "-*" in build


def test_what_wheels_are_tried_with_is_there_and_follows_the_code():
    content = parsed(ROOT / ".github" / "workflows" / "wheels.yml")
    asked = content["on"]["pull_request"]["paths"]
    assert {"src/**", "cpp/**", "CMakeLists.txt", "pyproject.toml"} <= set(asked)
    tried = " ".join(described()["tool"]["cibuildwheel"]["test-command"])
    files = re.findall(r"\{project\}/(\S+)", tried)
    assert files
    assert [name for name in files if not (ROOT / name).exists()] == []


def test_only_tags_are_published_and_only_with_all_wheels():
    job = parsed(ROOT / ".github" / "workflows" / "wheels.yml")["jobs"]["publish"]
    assert job["if"] == "startsWith(github.ref, 'refs/tags/v')"
    assert set(job["needs"]) == {"archive", "wheels"}
    assert job["environment"] == "pypi"


def test_the_site_that_is_published_is_the_one_that_is_built():
    every = steps(ROOT / ".github" / "workflows" / "docs.yml")
    (gathered,) = [step["run"].split()[3:] for step in every if "release.site" in step.get("run", "")]
    built, releases, output = gathered
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"sphinx.* {re.escape(built)}$", makefile, re.MULTILINE)
    assert [step["with"]["path"] for step in every if "upload" in step.get("uses", "")] == [output]
    (fetch,) = [step for step in every if "gh release download" in step.get("run", "")]
    assert f"--dir {releases}" in fetch["run"]
    # With `shell: bash` a failure inside a pipe stops the job; the default shell goes on.
    assert fetch["shell"] == "bash"


# --- the site of all versions -------------------------------------------------------------------------


def built_site(folder: Path, text: str) -> Path:
    folder.mkdir(parents=True)
    (folder / "index.html").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def releases(tmp_path):
    folder = tmp_path / "releases"
    for version in ("0.9.0", "0.10.1", "0.2.0"):
        pages = built_site(tmp_path / "pages" / version, version)
        shutil.make_archive(str(folder / f"docs-{version}"), "zip", pages)
    return folder


def test_the_site_has_a_folder_for_each_version_and_leads_to_the_last(tmp_path, releases):
    latest = built_site(tmp_path / "latest", "of main")
    listed = site.gather(latest, releases, tmp_path / "out")
    assert [version["folder"] for version in listed] == ["latest", "0.10.1", "0.9.0", "0.2.0"]
    assert json.loads((tmp_path / "out" / "versions.json").read_text(encoding="utf-8")) == listed
    texts = [(tmp_path / "out" / name["folder"] / "index.html").read_text(encoding="utf-8") for name in listed]
    assert texts == ["of main", "0.10.1", "0.9.0", "0.2.0"]
    assert 'url=0.10.1/"' in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")


def test_before_the_first_release_the_site_leads_to_the_development_version(tmp_path):
    (tmp_path / "releases").mkdir()
    site.gather(built_site(tmp_path / "latest", "of main"), tmp_path / "releases", tmp_path / "out")
    assert 'url=latest/"' in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")


def test_an_archive_without_a_version_or_a_first_page_is_refused(tmp_path, releases):
    latest = built_site(tmp_path / "latest", "of main")
    # One folder too deep.
    shutil.make_archive(str(releases / "docs-1.0.0"), "zip", tmp_path / "pages")
    with pytest.raises(site.SiteError, match=r"1\.0\.0"):
        site.gather(latest, releases, tmp_path / "deep")
    (releases / "docs-1.0.0.zip").rename(releases / "docs.zip")
    with pytest.raises(site.SiteError, match=r"found docs\.zip"):
        site.gather(latest, releases, tmp_path / "nameless")
