"""An audit calls nothing safe that it could not look up."""

from __future__ import annotations

import json
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

SPEC = spec_from_file_location("audit", Path(__file__).parent.parent / "deploy" / "audit.py")
assert SPEC is not None
assert SPEC.loader is not None
audit = module_from_spec(SPEC)
SPEC.loader.exec_module(audit)


def test_vulnerabilities_are_named_with_the_version_that_mends_them() -> None:
    fault = {"id": "CVE-1", "fix_versions": ["1.2"]}
    packages = [{"name": "a", "version": "1.1", "vulns": [fault]}, {"name": "b", "version": "3", "vulns": []}]
    assert audit.python_verdict(json.dumps({"dependencies": packages})) == (["a 1.1: CVE-1, mended in 1.2"], [])
    faults = {"vulnerabilities": {"c": {"range": "<2", "severity": "high"}}}
    assert audit.browser_verdict(json.dumps(faults)) == (["c <2: high"], [])


def test_what_could_not_be_looked_up_is_unknown() -> None:
    skipped = {"dependencies": [{"name": "a", "skip_reason": "not found"}]}
    assert audit.python_verdict(json.dumps(skipped)) == ([], ["a"])
    assert audit.python_verdict("") == audit.browser_verdict('{"error": {}}') == ([], ["all packages"])
