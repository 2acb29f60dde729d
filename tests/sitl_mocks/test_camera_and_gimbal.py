"""The camera component and the gimbal."""

import io
import json
import math
from concurrent.futures import Future

import numpy as np
import pytest
from PIL import Image
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.frames import GeoPoint
from sitl_mocks.gimbal import Gimbal
from sitl_mocks.picture import Exposure, Scene, jpeg, load_scene, render

M = mavlink
NAN = math.nan


def test_the_camera_is_a_component_of_its_own(either):
    heartbeats = [m for m in either.of("HEARTBEAT", either.run(3.0)) if m.get_srcComponent() == 100]
    assert len(heartbeats) == 3
    assert {m.type for m in heartbeats} == {M.MAV_TYPE_CAMERA}
    for number in (259, 260, 261, 262):
        assert either.command(M.MAV_CMD_REQUEST_MESSAGE, number, component=100) == [0]
    answers = either.heard[-8:]
    kinds = {m.get_type() for m in answers if m.get_srcComponent() == 100}
    assert {"CAMERA_INFORMATION", "CAMERA_SETTINGS", "STORAGE_INFORMATION", "CAMERA_CAPTURE_STATUS"} <= kinds


def capture(g, sequence, **kwargs):
    return g.command(M.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, sequence, component=100, **kwargs)


def test_a_capture_command_that_is_sent_again_takes_one_picture(px4):
    assert capture(px4, 1) == [0]
    assert capture(px4, 1) == [0]
    px4.run(0.1)
    (captured,) = px4.of("CAMERA_IMAGE_CAPTURED")
    assert captured.get_srcComponent() == 100
    assert (captured.image_index, captured.capture_result, captured.file_url) == (0, 1, "mftp:/DCIM/IMG_0001.JPG")
    assert captured.time_boot_ms == pytest.approx(px4.vehicle.time_s * 1e3, abs=150)
    assert capture(px4, 2) == [0]
    px4.run(0.1)
    assert [m.image_index for m in px4.of("CAMERA_IMAGE_CAPTURED")] == [0, 1]
    assert px4.of("CAMERA_CAPTURE_STATUS")[-1].image_count == 2


def test_a_new_flight_may_count_its_captures_from_one_again(px4):
    capture(px4, 1)
    px4.arm()
    capture(px4, 1)
    assert len(px4.vehicle.camera.shots) == 2


def test_a_lost_announcement_can_be_asked_for(px4):
    px4.listening = False
    capture(px4, 1)
    px4.run(0.1)
    px4.listening = True
    assert px4.of("CAMERA_IMAGE_CAPTURED") == []
    assert px4.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, 0, component=100) == [0]
    assert px4.of("CAMERA_IMAGE_CAPTURED")[0].image_index == 0
    assert px4.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, 5, component=100) == [
        M.MAV_RESULT_DENIED
    ]


def test_a_series(px4):
    assert px4.command(M.MAV_CMD_IMAGE_START_CAPTURE, 0, 0.5, 4, 0, component=100) == [0]
    px4.run(3.0)
    times = [m.time_boot_ms for m in px4.of("CAMERA_IMAGE_CAPTURED")]
    assert np.diff(times) == pytest.approx([500, 500, 500], abs=21)
    px4.command(M.MAV_CMD_IMAGE_START_CAPTURE, 0, 0.5, 0, 0, component=100)
    px4.run(1.2)
    assert px4.command(M.MAV_CMD_IMAGE_STOP_CAPTURE, 0, component=100) == [0]
    count = len(px4.vehicle.camera.shots)
    px4.run(2.0)
    assert len(px4.vehicle.camera.shots) == count
    assert px4.command(M.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 3, 0, component=100) == [M.MAV_RESULT_DENIED]


def test_a_picture_is_told_of_only_when_its_file_is_there(make_ground):
    pending = []

    g = make_ground("px4")
    g.vehicle.camera._draw = lambda exposure: pending.append(Future()) or pending[-1]
    capture(g, 1)
    capture(g, 2)
    pending[1].set_result(b"second")
    g.run(0.2)
    assert g.of("CAMERA_IMAGE_CAPTURED") == []
    pending[0].set_result(b"first")
    g.run(0.2)
    assert [m.image_index for m in g.of("CAMERA_IMAGE_CAPTURED")] == [0, 1]
    assert g.vehicle.folder.files == {"/DCIM/IMG_0001.JPG": b"first", "/DCIM/IMG_0002.JPG": b"second"}


def test_ardupilot_tells_of_exposures_without_file_names(ardupilot):
    ardupilot.in_air(6.0)
    assert ardupilot.command(M.MAV_CMD_DO_DIGICAM_CONTROL, 0, 0, 0, 0, 1) == [0]
    ardupilot.run(0.2)
    (feedback,) = ardupilot.of("CAMERA_FEEDBACK")
    assert feedback.get_srcComponent() == 1
    assert (feedback.cam_idx, feedback.img_idx) == (0, 1)
    assert feedback.alt_rel == pytest.approx(6.0, abs=0.3)
    assert feedback.alt_msl == pytest.approx(10.0, abs=0.3)
    assert feedback.yaw == pytest.approx(0.0, abs=0.5)
    assert feedback.time_usec == pytest.approx(ardupilot.vehicle.unix_s * 1e6, abs=3e5)
    assert ardupilot.of("CAMERA_IMAGE_CAPTURED") == []
    assert list(ardupilot.vehicle.folder.files) == ["/DCIM/IMG_0001.JPG"]
    assert ardupilot.command(M.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, 7) == [0]
    assert len(ardupilot.vehicle.camera.shots) == 2


def test_the_gimbal_turns_at_its_rate_within_its_range():
    gimbal = Gimbal(rate_deg_s=60.0)
    assert gimbal.point(math.radians(-45.0))
    for _ in range(25):
        gimbal.step(0.02)
    assert math.degrees(gimbal.pitch_rad) == pytest.approx(-30.0)
    for _ in range(25):
        gimbal.step(0.02)
    assert math.degrees(gimbal.pitch_rad) == pytest.approx(-45.0)
    gimbal.point(math.radians(-120.0))
    gimbal.step(10.0)
    assert math.degrees(gimbal.pitch_rad) == pytest.approx(-90.0)
    assert not gimbal.point(NAN)
    assert math.degrees(gimbal.target_rad) == pytest.approx(-90.0)


def test_gimbal_commands_and_telemetry(either):
    either.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS, 100_000)
    either.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_MOUNT_STATUS, 100_000)
    if either.vehicle.kind == "px4":
        assert either.command(M.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -35.0, 0, NAN, NAN) == [0]
    else:
        assert either.command(M.MAV_CMD_DO_MOUNT_CONTROL, -35.0, 0, 0, 0, 0, 0, 2) == [0]
    either.run(2.0)
    w, x, y, z = either.of("GIMBAL_DEVICE_ATTITUDE_STATUS")[-1].q
    assert math.degrees(math.asin(2 * (w * y - z * x))) == pytest.approx(-35.0, abs=0.01)
    assert either.of("MOUNT_STATUS")[-1].pointing_a == -3500


# Pictures -------------------------------------------------------------------------------------------------------------


def box(size, centre):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0 * size + centre
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return corners, np.array(faces)


def exposure(yaw=0.0, pitch=0.0, position=(0.0, 0.0, 10.0)):
    return Exposure(
        index=3, sequence=7, position_m=np.array(position), place=GeoPoint(31.3622, 121.6155, 14.25),
        home_altitude_m=4.0, yaw_rad=yaw, pitch_rad=pitch, roll_rad=0.0, boot_s=12.5, unix_s=1795321911.179,
    )  # fmt: skip


def orange(pixels):
    """Share of pixels with the structure's colour."""
    r, g, b = (pixels[..., k].astype(int) for k in range(3))
    return ((r > g + 25) & (g > b + 15)).mean()


def test_hits_of_rays_match_the_geometry():
    scene = Scene(*box(np.array([4.0, 4.0, 20.0]), np.array([10.0, 0.0, 10.0])), 0.0)
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    distance, normal, solid = scene.first_hits(np.array([0.0, 0.0, 10.0]), directions)
    assert distance[:2] == pytest.approx([8.0, 10.0], abs=1e-4)
    assert np.isinf(distance[2:]).all()
    assert solid.tolist() == [True, False, False, False]
    assert np.abs(normal[0]) == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert normal[1] == pytest.approx([0.0, 0.0, 1.0])


def test_a_picture_in_the_wrong_direction_shows():
    scene = Scene(*box(np.array([4.0, 4.0, 20.0]), np.array([10.0, 0.0, 10.0])), 0.0)
    toward, away = render(scene, exposure(yaw=0.0)), render(scene, exposure(yaw=math.pi))
    assert orange(toward) == pytest.approx(0.33, abs=0.05)  # 4 m wide at 8 m, in a view of 1.5 x the distance
    assert orange(away) == 0.0
    left = render(scene, exposure(yaw=math.radians(20.0)))  # turned left: the box is right of the middle
    assert orange(left[:, 160:]) > 3 * orange(left[:, :160])
    down = render(scene, exposure(pitch=math.radians(-90.0)))
    assert orange(down) == 0.0


def test_without_a_structure_there_are_ground_and_sky():
    pixels = render(load_scene(None, 0.0), exposure()).astype(int)
    sky, ground = pixels[20].mean(axis=0), pixels[-20].mean(axis=0)
    assert sky[2] > sky[0] + 40
    assert ground[1] > ground[2]


def test_exif_tells_place_direction_and_time():
    picture = jpeg(render(load_scene(None, 0.0), exposure(yaw=0.5, pitch=-0.25)), exposure(yaw=0.5, pitch=-0.25))
    image = Image.open(io.BytesIO(picture))
    assert image.size == (320, 213)
    exif = image.getexif()
    details, gps = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
    degrees = [float(d) + float(m) / 60 + float(s) / 3600 for d, m, s in (gps[2], gps[4])]
    assert degrees == pytest.approx([31.3622, 121.6155], abs=1e-9)
    assert (gps[1], gps[3], gps[16]) == ("N", "E", "T")
    assert float(gps[6]) == pytest.approx(14.25)
    assert float(gps[17]) == pytest.approx(90.0 - math.degrees(0.5), abs=1e-3)
    assert (details[0x9003], details[0x9291]) == ("2026:11:22 04:31:51", "179")
    comment = json.loads(details[0x9286][8:])
    assert comment == {
        "index": 3, "sequence": 7, "yaw_rad": 0.5, "pitch_rad": -0.25, "position_m": [0.0, 0.0, 10.0], "boot_s": 12.5,
    }  # fmt: skip


def test_a_mesh_file_is_seen(tmp_path):
    import trimesh

    vertices, faces = box(np.array([2.0, 2.0, 2.0]), np.array([5.0, 0.0, 10.0]))
    file = tmp_path / "box.ply"
    trimesh.Trimesh(vertices, faces).export(file)
    assert orange(render(load_scene(file, 0.0), exposure())) > 0.1
