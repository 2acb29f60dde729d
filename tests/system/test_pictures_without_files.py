"""A flight whose camera serves no files: each picture is sent packet by packet when it has been taken.

Only the newest picture can be asked for: each must arrive before the next is taken. So no clock runs faster here.
"""

import zlib

import pytest

from gcs.storage.plan_files import read_plan

pytestmark = pytest.mark.system


async def test_every_picture_is_sent_and_whole(gcs, vehicle, small_plan, tmp_path, records):
    drone = vehicle("px4", "--no-picture-files", "--loss", "0.05", plan=small_plan, speedup=1, card=tmp_path / "card")
    data = tmp_path / "data"
    told = await gcs(
        "fly", small_plan, "--connect", drone.url, "--mode", "mission", "--yes", drone.name, "--json", "--data", data
    )
    points = len(read_plan(small_plan).viewpoints)
    assert told.status == 0, told.text
    assert told.summary["images_received"] == points
    stored = records(data).rows("select flight_id, file_name from images where state = 'stored'")
    ours = sorted(zlib.crc32((data / "images" / flight / name).read_bytes()) for flight, name in stored)
    assert ours == sorted(drone.files().values())
