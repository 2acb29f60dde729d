"""A signing key in a file of its own."""

from __future__ import annotations

import pytest

from gcs.core.errors import InputError
from gcs.storage.key_files import read_key_file, write_key_file

KEY = bytes(range(32))


def test_key_files_that_are_none_are_refused(tmp_path):
    key_file = tmp_path / "key"
    write_key_file(key_file, KEY)
    assert read_key_file(key_file) == KEY
    with pytest.raises(InputError, match="cannot be read"):
        read_key_file(tmp_path / "none")
    for text in ("", "00" * 31, "xy" * 32, "\N{SNOWMAN}"):
        key_file.write_text(text)
        with pytest.raises(InputError, match="no key"):
            read_key_file(key_file)
    write_key_file(key_file, KEY)
    key_file.chmod(0o640)
    with pytest.raises(InputError, match="others can read"):
        read_key_file(key_file)
