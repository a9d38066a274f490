"""The page for users of the R packages names each of their functions once."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from pkgutil import resolve_name

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "coming-from" / "r.md"
NAMES = ROOT.parent / "shared" / "reference" / "r_functions.txt"
"""Names of the published indexes of functions, one a line, with the packages as comments."""
INTERNAL = """
    desc.to.ts.model desc_decomp_theo_fun inv_logit inv_param_transform inv_transform_phi is.cvwvic is.gmwm is.gts
    is.imu is.lts is.mgmwm is.mimu is.ts.model is.tsmodel is.whole is.wholenumber is.wvar Ma_cpp Ma_cpp_vec
    model_objdesc model_process_desc model_theta orderModel param_transform sp_hfilter sp_modwt_cpp transform_phi
"""
"""Helpers of R that a user does not call; the page leaves them out."""


def test_each_function_of_the_published_indexes_has_one_row():
    if not NAMES.exists():
        pytest.skip("the list of names is not at hand")
    names = {line for line in NAMES.read_text(encoding="utf-8").split("\n") if line and not line.startswith("#")}
    section = PAGE.read_text(encoding="utf-8").partition("## Every function")[2].partition("From other packages")[0]
    rows = [line.split(" | ") for line in section.split("\n") if line.startswith("| `")]
    counts = Counter(name for row in rows for name in re.findall("`([^`]+)`", row[0]))
    assert set(counts) == names - set(INTERNAL.split())
    assert set(counts.values()) == {1}
    assert all(row[-1].rstrip(" |") for row in rows)


def test_each_name_of_gmwm_in_the_tables_exists():
    section = PAGE.read_text(encoding="utf-8").partition("## Every function")[2].partition("## The same numbers")[0]
    rows = [line.split(" | ") for line in section.split("\n") if line.startswith("| ")]
    codes = [code for row in rows if len(row) > 1 for code in re.findall("`([^`]+)`", row[1])]
    names = {match[1] for code in codes if (match := re.match(r"(?:gmwm\.)?([a-z_]+(?:\.[a-z_]+)*)(?:\(|$)", code))}
    objects = ("fit", "ml", "wv", "curves", "calibration", "made", "numpy")
    names = {name for name in names if not name.startswith(tuple(f"{object}." for object in objects))}
    names = {name for name in names if "." in name or any(f"{name}(" in code for code in codes)}
    assert len(names) > 12
    for name in names:
        resolve_name(f"gmwm.{name}")
