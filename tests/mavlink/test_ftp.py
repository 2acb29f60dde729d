"""MAVLink FTP on fake time against a scripted server with every fault that we know of."""

from __future__ import annotations

import math
import random
import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import (
    ConflictError,
    IncompleteError,
    InputError,
    LinkError,
    NotFoundError,
    OperationCancelled,
    RefusedError,
)
from gcs.mavlink.byte_gaps import ByteGaps
from gcs.mavlink.ftp_directory import ListDirectory
from gcs.mavlink.ftp_fetch import FetchFile
from gcs.mavlink.ftp_protocol import (
    FtpPayload,
    SequenceNumbers,
    checksum_agrees,
    decode,
    file_name_of,
    is_plain_name,
    parse_listing,
    path_from_url,
)
from gcs.mavlink.partial_file import PartialFile
from gcs.storage.image_parts import ImagePart

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"


def table_crc32(data: bytes) -> int:
    """Bit by bit: reflected 0x04C11DB7, start 0, no inversion."""
    state = 0
    for byte in data:
        state ^= byte
        for _ in range(8):
            state = (state >> 1) ^ (0xEDB88320 if state & 1 else 0)
    return state


class FileServer:
    """One session, answers a repeated number with the same answer, streams bursts at 5 ms a packet."""

    def __init__(self, clock) -> None:
        self.clock = clock
        self.files: dict[str, bytes] = {}
        self.listing: list[bytes] = []
        self.put = lambda message, source=None: None
        self.deadline = math.inf
        self.session: str | None = None
        self.last: tuple[int, bytes] | None = None
        self.burst: tuple[int, int, int] | None = None
        self.longest_burst = 100
        self.announced = {}
        self.crc = table_crc32
        self.has_crc = self.has_burst = True
        self.alter = lambda raw: [raw]
        self.opened = 0

    def say(self, sequence, opcode, request, *, size=0, offset=0, data=b"", complete=0, keep=True) -> None:
        raw = struct.pack("<HBBBBBBI", sequence % 65536, 3, opcode, size, request, complete, 0, offset) + data
        raw = raw.ljust(251, b"\0")
        if keep:
            self.last = (sequence % 65536, raw)
        for altered in self.alter(raw):
            self.put(mavlink.MAVLink_file_transfer_protocol_message(0, 255, 190, altered))

    def nak(self, sequence, request, error) -> None:
        self.say(sequence, 129, request, size=1, data=bytes([error]))

    def hear(self, message) -> None:
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return
        raw = bytes(message.payload)
        sequence, _session, opcode, size, _, _, _, offset = struct.unpack_from("<HBBBBBBI", raw)
        data = raw[12 : 12 + size]
        reply = (sequence + 1) % 65536
        if self.last is not None and self.last[0] == reply:
            self.put(mavlink.MAVLink_file_transfer_protocol_message(0, 255, 190, self.last[1]))
            return
        path = data.decode("utf-8", "replace")
        if opcode == 1:
            self.session, self.burst, self.deadline = None, None, math.inf
            self.say(reply, 128, 1)
        elif opcode == 2:
            self.session, self.burst, self.deadline = None, None, math.inf
            self.say(reply, 128, 2)
        elif opcode == 3:
            rest = self.listing[offset:]
            if path != "/DCIM":
                self.say(reply, 129, 3, size=2, data=bytes([2, 2]))
            elif not rest:
                self.nak(reply, 3, 6)
            else:
                out = b""
                for entry in rest:
                    if len(out) + len(entry) + 1 > 239:
                        break
                    out += entry + b"\0"
                self.say(reply, 128, 3, size=len(out), offset=offset, data=out)
        elif opcode == 4:
            if self.session is not None:
                self.nak(reply, 4, 5)
            elif path not in self.files:
                self.nak(reply, 4, 10)
            else:
                self.session = path
                self.opened += 1
                length = self.announced.get(path, len(self.files[path]))
                self.say(reply, 128, 4, size=4, data=struct.pack("<I", length))
        elif opcode in (5, 15) and self.session is None:
            self.nak(reply, opcode, 4)
        elif opcode == 5:
            part = self.files[self.session][offset : offset + size]
            if part:
                self.say(reply, 128, 5, size=len(part), offset=offset, data=part)
            else:
                self.nak(reply, 5, 6)
        elif opcode == 15 and self.has_burst:
            self.burst, self.deadline = (reply, offset, self.longest_burst), self.clock() + 0.005
        elif opcode == 14 and self.has_crc:
            self.say(reply, 128, 14, size=4, data=struct.pack("<I", self.crc(self.files[path])))
        else:
            self.nak(reply, opcode, 7)

    def on_time(self) -> None:
        sequence, offset, left = self.burst
        part = self.files[self.session][offset : offset + 239]
        self.deadline = self.clock() + 0.005
        self.burst = (sequence + 1, offset + 239, left - 1)
        if not part:
            self.say(sequence, 129, 15, size=1, data=bytes([6]), keep=False)
            self.burst, self.deadline = None, math.inf
        else:
            complete = int(left == 1)
            self.say(sequence, 128, 15, size=len(part), offset=offset, data=part, complete=complete, keep=False)
            if complete:
                self.burst, self.deadline = None, math.inf

    def reboot(self) -> None:
        self.session, self.burst, self.last, self.deadline = None, None, None, math.inf


CONTENT = random.Random(3).randbytes(60_001)
PATH = "/DCIM/IMG_0001.jpg"


@pytest.fixture
def serve(make_rig):
    def make(content=CONTENT, **faults):
        rig = make_rig(FileServer, **faults)
        rig.vehicle.files = {PATH: content}
        return rig

    return make


def fetch(rig, path=PATH, **options):
    transaction = FetchFile(path, 1, 1, rig.send, rig.clock, own_system=255, **options)
    rig.drive(transaction)
    return transaction.result()


@pytest.mark.parametrize("size", [0, 1, 238, 239, 240, 239 * 24, 60_001])
def test_every_size_on_a_clean_link(serve, size):
    rig = serve(CONTENT[:size])
    got = fetch(rig)
    assert got.data == CONTENT[:size]
    assert got.crc32 == zlib.crc32(CONTENT[:size])
    assert got.confirmed
    assert rig.vehicle.session is None, "the file was left open"


def test_a_burst_is_faster_than_lock_step(serve):
    rig = serve(delay_s=0.1)
    fetch(rig)
    assert rig.clock.now - 100 < 60_001 / 239 * 0.2 / 8


@pytest.mark.parametrize("loss", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("seed", range(10))
def test_loss_doubling_reordering_and_corruption(serve, loss, seed):
    rig = serve(seed=seed, loss=loss, double=0.2, jitter_s=0.05, corrupt=0.02)
    got = fetch(rig)
    assert got.data == CONTENT
    assert got.confirmed


@pytest.mark.parametrize("loss", [0.1, 0.3])
def test_loss_costs_no_second_a_packet(serve, loss):
    rig = serve(seed=2, loss=loss)
    fetch(rig)
    lost = 60_001 / 239 * loss
    assert rig.clock.now - 100 < 3 + 0.25 * lost


def test_usual_zlib_checksum_is_taken_too(serve):
    rig = serve()
    rig.vehicle.crc = zlib.crc32
    assert fetch(rig).confirmed


def test_vehicle_without_checksums_says_so(serve):
    rig = serve()
    rig.vehicle.has_crc = False
    got = fetch(rig)
    assert got.data == CONTENT
    assert not got.confirmed


def test_vehicle_without_bursts(serve):
    rig = serve()
    rig.vehicle.has_burst = False
    assert fetch(rig).data == CONTENT


def test_damaged_file_is_never_given_out(serve):
    rig = serve()
    rig.vehicle.crc = lambda data: 12345
    with pytest.raises(IncompleteError, match="damaged"):
        fetch(rig)
    assert rig.vehicle.opened == 4


def test_damage_that_happens_once_is_mended(serve):
    rig = serve()
    spoiled = []

    def spoil(raw):
        if raw[3] == 128 and raw[5] == 15 and not spoiled:
            spoiled.append(True)
            return [raw[:50] + bytes([raw[50] ^ 1]) + raw[51:]]
        return [raw]

    rig.vehicle.alter = spoil
    assert fetch(rig).data == CONTENT
    assert rig.vehicle.opened == 2


def test_reboot_in_mid_file_goes_on(serve):
    rig = serve()
    rig.at.append((100.6, rig.vehicle.reboot))
    assert fetch(rig).data == CONTENT
    assert rig.vehicle.opened == 2


def test_session_that_a_killed_station_left_is_reset(serve):
    rig = serve()
    rig.vehicle.session = PATH
    assert fetch(rig).data == CONTENT


def test_a_server_that_serves_another_is_a_conflict(serve):
    rig = serve()
    rig.vehicle.session = PATH
    rig.vehicle.alter = lambda raw: [raw]
    real = rig.vehicle.hear

    def stubborn(message):
        real(message)
        rig.vehicle.session = PATH

    rig.vehicle.hear = stubborn
    with pytest.raises(ConflictError):
        fetch(rig)


@pytest.mark.parametrize("size", [2**32 - 1, 65 << 20])
def test_absurd_size_is_refused_and_the_file_closed(serve, size):
    rig = serve()
    rig.vehicle.announced = {PATH: size}
    with pytest.raises(RefusedError, match="more than"):
        fetch(rig)
    rig.pass_time(0.1)
    assert rig.vehicle.session is None


def test_announced_size_that_is_too_large_is_settled_by_the_checksum(serve):
    rig = serve()
    rig.vehicle.announced = {PATH: 70_000}
    assert fetch(rig).data == CONTENT


def test_announced_size_that_is_too_large_without_a_checksum_is_not_believed(serve):
    rig = serve()
    rig.vehicle.announced = {PATH: 70_000}
    rig.vehicle.has_crc = False
    with pytest.raises(IncompleteError):
        fetch(rig)


def test_announced_size_that_is_too_small_is_found_out(serve):
    rig = serve()
    rig.vehicle.announced = {PATH: 30_000}
    with pytest.raises(IncompleteError):
        fetch(rig)


def test_data_outside_the_file_and_nonsense_are_ignored(serve):
    rig = serve()

    def mad(raw):
        beyond = raw[:8] + struct.pack("<I", 4_000_000_000) + raw[12:]
        fat = raw[:4] + bytes([255]) + raw[5:]
        return [beyond, fat, raw] if raw[5] == 15 and raw[3] == 128 else [raw]

    rig.vehicle.alter = mad
    assert fetch(rig).data == CONTENT


def test_files_of_another_component_and_for_another_station_are_ignored(serve):
    rig = serve()

    def others(raw):
        wrong = raw[:12] + bytes(239)
        rig.down.put(mavlink.MAVLink_file_transfer_protocol_message(0, 255, 190, wrong), (1, 100))
        rig.down.put(mavlink.MAVLink_file_transfer_protocol_message(0, 254, 190, wrong))
        return [raw]

    rig.vehicle.alter = others
    got = fetch(rig)
    assert got.data == CONTENT
    assert rig.vehicle.opened == 1


def test_link_gone_keeps_what_came_and_goes_on_later(serve):
    rig = serve()
    rig.at.append((100.7, lambda: setattr(rig.down.faults, "loss", 1.0)))
    first = FetchFile(PATH, 1, 1, rig.send, rig.clock)
    rig.drive(first)
    with pytest.raises(LinkError):
        first.result()
    partial = first.partial
    missing = sum(b - a for a, b in partial.gaps)
    assert 0 < missing < 60_001
    rig.down.faults.loss = 0.0
    rig.pass_time(1.0)
    before = rig.down.sent
    assert fetch(rig, resume=partial).data == CONTENT
    assert rig.down.sent - before < missing / 239 + 20


def test_resuming_another_files_leftovers_ends_in_the_right_file(serve):
    rig = serve()
    stale = PartialFile(60_001, bytes(60_001), ((0, 1000),))
    assert fetch(rig, resume=stale).data == CONTENT


def left_behind(rig, path, until_s):
    """What is on the disk of a station that was killed in mid-fetch."""
    part = ImagePart(path)
    fetching = FetchFile(PATH, 1, 1, rig.send, rig.clock, keep=part)
    rig.at.append((until_s, lambda: setattr(rig.down.faults, "loss", 1.0)))
    killed = path.with_suffix(".killed")
    rig.at.append((until_s, lambda: killed.write_bytes(path.read_bytes())))
    rig.drive(fetching)
    part.close()
    killed.replace(path)
    rig.down.faults.loss = 0.0
    rig.pass_time(1.0)


def gone_on_with(rig, path):
    part = ImagePart(path)
    got = fetch(rig, resume=PartialFile.of_pieces(*part.load()), keep=part)
    part.close()
    size, pieces = ImagePart(path).load()
    whole = PartialFile.of_pieces(size, pieces)
    assert (whole.data, whole.gaps) == (got.data, ()), "what is kept is what was fetched"
    return got


@pytest.mark.parametrize(("loss", "until_s"), [(0.0, 100.7), (0.1, 101.2)])
def test_a_station_that_was_killed_goes_on_where_it_stopped(serve, tmp_path, loss, until_s):
    rig = serve(loss=loss)
    path = tmp_path / "image-1.part"
    left_behind(rig, path, until_s)
    kept = sum(len(data) for _, data in ImagePart(path).load()[1])
    assert 0.2 * len(CONTENT) < kept < 0.9 * len(CONTENT)
    before = rig.down.sent
    got = gone_on_with(rig, path)
    assert got.data == CONTENT
    assert got.confirmed
    assert rig.down.sent - before < (len(CONTENT) - kept) / 239 * (1 + 3 * loss) + 20


@pytest.mark.parametrize("has_crc", [True, False])
@pytest.mark.parametrize("size", [60_001, 59_999, 70_000])
def test_parts_of_another_file_of_that_name_are_not_mixed_in(serve, tmp_path, size, has_crc):
    rig = serve(random.Random(9).randbytes(size))
    path = tmp_path / "image-1.part"
    left_behind(rig, path, until_s=100.7)
    rig.vehicle.files[PATH] = CONTENT
    rig.vehicle.has_crc = has_crc
    got = gone_on_with(rig, path)
    assert got.data == CONTENT
    assert got.confirmed == has_crc


def test_missing_file(serve):
    with pytest.raises(NotFoundError):
        fetch(serve(), "/DCIM/none.jpg")


def test_silent_vehicle(serve):
    rig = serve(up={"loss": 1.0})
    with pytest.raises(LinkError, match="does not answer"):
        fetch(rig)
    assert rig.clock.now - 100 < 20


@pytest.mark.parametrize("step", [1, 2, 5, 100, 230])
def test_cancel_closes_the_file(serve, step):
    rig = serve()
    heard = []

    def count(transaction, message):
        heard.append(message)
        if len(heard) == step:
            transaction.cancel()

    rig.on_heard = count
    with pytest.raises(OperationCancelled):
        fetch(rig)
    rig.on_heard = lambda t, m: None
    rig.pass_time(0.1)
    assert rig.vehicle.session is None


def test_progress_tells_and_can_cancel(serve):
    told = []
    fetch(serve(), on_progress=lambda held, total: told.append((held, total)))
    assert told[-1] == (60_001, 60_001)
    assert told == sorted(told)

    def stop(held, total):
        raise OperationCancelled("enough")

    with pytest.raises(OperationCancelled):
        fetch(serve(), on_progress=stop)


def test_one_after_another_with_shared_numbers(serve):
    rig = serve(seed=7, loss=0.2)
    rig.vehicle.files = {f"/DCIM/{n}": random.Random(n).randbytes(700 * n) for n in range(12)}
    numbers = SequenceNumbers(65_500)
    for path, content in rig.vehicle.files.items():
        assert fetch(rig, path, sequence=numbers).data == content


def listing(rig):
    transaction = ListDirectory("/DCIM", 1, 1, rig.send, rig.clock)
    rig.drive(transaction)
    return transaction.result()


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_long_listing(serve, loss):
    rig = serve(seed=5, loss=loss, double=loss)
    rig.vehicle.listing = [b"D.", b"D..", b"S"] + [b"FIMG_%04d.jpg\t%d" % (n, 1000 + n) for n in range(300)] + [b"Draw"]
    result = listing(rig)
    assert [(e.name, e.size) for e in result.entries[:-1]] == [(f"IMG_{n:04d}.jpg", 1000 + n) for n in range(300)]
    assert result.entries[-1].is_directory
    assert result.dropped == ()


def test_names_that_are_no_plain_names_are_dropped_and_said(serve):
    bad = [b"F../../etc/passwd\t3", b"F/abs\t3", b"Fa\\b\t3", b"F\x01x\t3", b"Fnosize", b"Fx\t-5", b"Qodd", b"D../up"]
    rig = serve()
    rig.vehicle.listing = [*bad, b"Fgood.jpg\t5", b"Fgood.jpg\t6"]
    result = listing(rig)
    assert [(e.name, e.size) for e in result.entries] == [("good.jpg", 5)]
    assert len(result.dropped) == len(bad)


def test_listing_that_never_ends_is_ended(serve):
    rig = serve()
    rig.vehicle.listing = [b"Fx\t1"] * 40_000
    result = listing(rig)
    assert len(result.entries) == 1
    assert "everything after" in result.dropped[-1]


def test_missing_folder(serve):
    transaction = ListDirectory("/none", 1, 1, (rig := serve()).send, rig.clock)
    rig.drive(transaction)
    with pytest.raises(NotFoundError):
        transaction.result()


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/b", "a\\b", "c:x", "a\0b", "a\nb", "x" * 201, " a", "a.", "\u202egpj"]
)
def test_names_that_are_not_plain(name):
    assert not is_plain_name(name)


@pytest.mark.parametrize("name", ["IMG_0001.JPG", "a b.jpg", "ünïcode.png", ".hidden"])
def test_names_that_are_plain(name):
    assert is_plain_name(name)
    assert file_name_of(f"/DCIM/{name}") == name


def test_addresses():
    assert path_from_url("mftp:/DCIM/a.jpg") == ("/DCIM/a.jpg", None)
    assert path_from_url("mftp:///DCIM/a.jpg") == ("/DCIM/a.jpg", None)
    assert path_from_url("mftp://[;comp=100]/DCIM/a.jpg") == ("/DCIM/a.jpg", 100)
    assert path_from_url("/DCIM/a.jpg") == ("/DCIM/a.jpg", None)
    for bad in ("http://x/a", "mftp:/../a", "mftp://[;comp=0]/a", "mftp://[;comp=x]/a", "", "a/../../b", "x" * 300):
        with pytest.raises(InputError):
            path_from_url(bad)


@given(st.binary(min_size=0, max_size=251))
def test_any_payload_is_read_or_dropped(raw):
    message = mavlink.MAVLink_file_transfer_protocol_message(0, 255, 190, raw.ljust(251, b"\0"))
    payload = decode(message)
    if payload is not None:
        assert len(payload.data) <= 239
        _ = payload.error
        parse_listing(payload.data)


@given(
    st.integers(0, 65535),
    st.sampled_from([4, 5, 15, 128]),
    st.integers(0, 255),
    st.integers(0, 2**32 - 1),
    st.binary(max_size=239),
)
def test_payload_round_trip(sequence, opcode, session, offset, data):
    sent = FtpPayload(sequence, opcode, session, len(data), 5, True, offset, data)
    message = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, sent.encode())
    assert decode(message) == sent


@given(st.binary(max_size=300), st.binary(min_size=1, max_size=4))
def test_checksums(data, more):
    assert checksum_agrees(data, table_crc32(data))
    assert checksum_agrees(data, zlib.crc32(data))
    if table_crc32(data + more) not in {table_crc32(data), zlib.crc32(data)}:
        assert not checksum_agrees(data, table_crc32(data + more))


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), max_size=12), st.integers(0, 50))
def test_gaps_against_a_set(pieces, cut):
    gaps, missing = ByteGaps([(0, 50)]), set(range(50))
    for start, end in pieces:
        came = set(range(start, end)) & missing
        assert gaps.fill(start, end) == len(came)
        missing -= came
        assert gaps.missing == len(missing)
        assert {k for a, b in gaps for k in range(a, b)} == missing
        assert all(b < c for (_, b), (c, _) in zip(list(gaps), list(gaps)[1:], strict=False))
    gaps.cut(cut)
    assert {k for a, b in gaps for k in range(a, b)} == {k for k in missing if k < cut}


@pytest.mark.skipif(not RECORDS.is_dir(), reason="the recorded traffic is not here")
def test_recorded_answers_of_ardupilot_are_understood():
    raw = (RECORDS / "ardupilot/timing_ftp_fence.tlog").read_bytes()
    parser = mavlink.MAVLink(None)
    place, names, bursts = 0, set(), 0
    while place + 8 < len(raw):
        place += 8
        size = 12 + raw[place + 1] + (13 if raw[place + 2] & 1 else 0) if raw[place] == 0xFD else 8 + raw[place + 1]
        for message in parser.parse_buffer(raw[place : place + size]) or []:
            if message.get_type() == "FILE_TRANSFER_PROTOCOL":
                payload = decode(message)
                assert payload is not None
                if payload.request == 3 and payload.error is None:
                    _, entries, dropped = parse_listing(payload.data)
                    names |= {e.name for e in entries}
                    assert not dropped
                bursts += payload.request == 15 and payload.error is None
        place += size
    assert {"terrain", "@ROMFS", "@SYS", "threads.txt", "locations.txt"} <= names
    assert bursts > 10
