import os

import pytest

from gcs.core.errors import ConflictError, InputError, StorageError
from gcs.storage.signing_keys import FILE, SigningKeyStore, StoredKey

URL, OTHER = "udpin:0.0.0.0:14550", "serial:/dev/ttyUSB0:57600"
PASSPHRASE = "correct horse"


def test_keys_come_back_with_the_passphrase_and_are_not_readable_in_the_file(tmp_path):
    store = SigningKeyStore(tmp_path / "data", PASSPHRASE)
    first, second = StoredKey(os.urandom(32), True), StoredKey(os.urandom(32), False, "2026-11-22T10:00:00Z")
    store.put(URL, first)
    store.put(OTHER, second)
    again = SigningKeyStore(tmp_path / "data", PASSPHRASE)
    assert (again.get(URL), again.get(OTHER), again.get("tcp:x:1")) == (first, second, None)
    path = tmp_path / "data" / FILE
    raw = path.read_bytes()
    assert first.key not in raw
    assert first.key.hex().encode() not in raw
    assert path.stat().st_mode & 0o077 == 0
    again.delete(URL)
    assert store.urls() == (OTHER,)
    assert first.key.hex() not in repr(first)


def test_without_a_file_no_passphrase_is_needed_to_read(tmp_path):
    assert SigningKeyStore(tmp_path, None).get(URL) is None


@pytest.mark.parametrize("passphrase", [None, "another one"])
def test_a_missing_or_wrong_passphrase_is_one_clear_line(tmp_path, passphrase):
    SigningKeyStore(tmp_path, PASSPHRASE).put(URL, StoredKey(bytes(32), True))
    with pytest.raises(InputError, match="GCS_KEY"):
        SigningKeyStore(tmp_path, passphrase).get(URL)
    with pytest.raises(InputError, match="GCS_KEY"):
        SigningKeyStore(tmp_path, passphrase).put(OTHER, StoredKey(bytes(32), True))
    assert SigningKeyStore(tmp_path, PASSPHRASE).urls() == (URL,)


def test_a_short_passphrase_is_refused_before_a_vehicle_gets_a_key(tmp_path):
    for passphrase in (None, "", "short"):
        with pytest.raises(InputError, match="at least 8"):
            SigningKeyStore(tmp_path, passphrase).check_passphrase()
    SigningKeyStore(tmp_path, PASSPHRASE).check_passphrase()


@pytest.mark.parametrize("damage", [b"", b"{}", b"[]", b'{"salt": 3, "keys": 4}', b'{"salt": "", "keys": ""}'])
def test_a_damaged_file_is_said(tmp_path, damage):
    (tmp_path / FILE).write_bytes(damage)
    with pytest.raises((StorageError, InputError)):
        SigningKeyStore(tmp_path, PASSPHRASE).get(URL)


def test_keys_that_were_kept_before_rotations_were_noted_are_still_read(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.storage.signing_keys.asdict", lambda each: {"rejects_unsigned": each.rejects_unsigned})
    SigningKeyStore(tmp_path, PASSPHRASE).put(URL, StoredKey(bytes(32), True, "2026-11-22T10:00:00Z"))
    assert SigningKeyStore(tmp_path, PASSPHRASE).get(URL) == StoredKey(bytes(32), True, None)


def test_a_pending_key_is_kept_beside_the_present_one_until_one_is_proved(tmp_path):
    keys, present, pending = (
        SigningKeyStore(tmp_path, "correct horse"),
        *(StoredKey(bytes([k]) * 32, True) for k in (1, 2)),
    )
    keys.put_pending("tcp:a:1", pending)
    assert (keys.get("tcp:a:1"), keys.known("tcp:a:1"), keys.urls()) == (None, pending, ("tcp:a:1",))
    keys.put("tcp:b:1", present)
    keys.put_pending("tcp:b:1", pending)
    assert (keys.get("tcp:b:1"), keys.known("tcp:b:1"), keys.pending("tcp:b:1")) == (present, present, pending)
    assert sorted(keys.urls()) == ["tcp:a:1", "tcp:b:1"]
    for url in keys.urls():
        with pytest.raises(ConflictError, match="set signing up again"):
            keys.proved(url)
    keys.put("tcp:b:1", pending)
    assert (keys.proved("tcp:b:1"), keys.pending("tcp:b:1"), keys.pending("tcp:a:1")) == (pending, None, pending)
    keys.delete("tcp:a:1")
    assert keys.urls() == ("tcp:b:1",)
