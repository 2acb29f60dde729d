"""Plans on a companion's disk."""

from __future__ import annotations

import hashlib

import pytest

from gcs.core.errors import InputError
from gcs.storage.kept_plans import KeptPlans

PLAN, STRUCTURE = b"{}", b"ply"
HASH = hashlib.sha256(PLAN).hexdigest()


def test_plans_are_kept_over_restarts_and_only_whole(tmp_path):
    KeptPlans(tmp_path).keep(HASH, PLAN, STRUCTURE)
    kept = KeptPlans(tmp_path)
    folder = kept.find(HASH)
    assert folder is not None
    (folder / "plan.json").write_bytes(b"{ }")
    assert kept.find(HASH) is None, "damaged"
    with pytest.raises(InputError, match="not the plan of this hash"):
        kept.keep("0" * 64, PLAN, STRUCTURE)
    with pytest.raises(InputError, match="64 hex digits"):
        kept.find("../../etc")
