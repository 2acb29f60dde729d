"""Time stamps of signatures that are claimed ahead."""

from __future__ import annotations

from gcs.storage.signing_stamps import SigningStamps


def test_stamps_are_claimed_before_they_are_used_up(tmp_path):
    stamps = SigningStamps(tmp_path / "stamp", 1000)
    stamps.claim(5000)
    assert not stamps.needs_claim(5400)
    assert stamps.needs_claim(5500)
    stamps.give_back(5600)
    assert SigningStamps(tmp_path / "stamp", 1000).read() == 5600


def test_a_damaged_file_claims_nothing_and_is_said(tmp_path, caplog):
    (tmp_path / "stamp").write_text("nonsense")
    assert SigningStamps(tmp_path / "stamp", 1000).read() == 0
    assert "holds no time stamp" in caplog.text
    assert SigningStamps(tmp_path / "none", 1000).read() == 0
