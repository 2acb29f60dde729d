from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.camera_control import ASK_EVERY_S, DESCRIPTION_TRIES, CameraWatch


class Bench:
    def __init__(self):
        self.sent = []
        self.watch = CameraWatch(1, self.sent.append)
        self.now = 0.0

    def hear(self, message, component=100):
        message._header.srcSystem, message._header.srcComponent = 1, component
        return self.watch.take(message)

    def camera(self, component=100):
        self.hear(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_CAMERA, 8, 0, 0, 4, 3), component)

    def image(self, index, component=100):
        name = f"mftp:/DCIM/{index}.jpg".encode()
        message = mavlink.MAVLink_camera_image_captured_message(
            1000, 0, 1, 313622000, 1216155000, 24000, 20000, [1, 0, 0, 0], index, 1, name
        )
        raw = message.pack(mavlink.MAVLink(None))
        return self.hear(mavlink.MAVLink(None).parse_buffer(raw)[0], component)

    def status(self, count):
        self.hear(mavlink.MAVLink_camera_capture_status_message(1000, 0, 0, 0.0, 0, 0.0, count))

    def asked(self, seconds=5.0):
        self.sent.clear()
        end = self.now + seconds
        while self.now < end:
            self.now += 0.1
            self.watch.on_time(self.now)
        assert all(m.command == 512 and m.target_component == 100 for m in self.sent)
        return [int(m.param2) for m in self.sent if m.param1 == 263]


def test_nobody_is_asked_before_a_camera_was_heard():
    bench = Bench()
    bench.watch.on_time(100.0)
    assert bench.sent == []
    assert bench.watch.component is None


def test_a_camera_is_known_by_its_heartbeat_or_by_a_picture():
    by_heartbeat = Bench()
    by_heartbeat.camera(101)
    assert by_heartbeat.watch.component == 101
    by_picture = Bench()
    assert by_picture.image(0).file == "mftp:/DCIM/0.jpg"
    assert by_picture.watch.component == 100


def test_the_count_is_asked_regularly():
    bench = Bench()
    bench.camera()
    bench.asked(ASK_EVERY_S * 3 + 0.05)
    assert [m.param1 for m in bench.sent].count(262) in (3, 4)


def test_lost_announcements_are_asked_for_until_they_come():
    bench = Bench()
    bench.camera()
    bench.image(0)
    bench.image(3)
    assert set(bench.asked()) == {1, 2}
    bench.image(1)
    assert set(bench.asked()) == {2}
    bench.image(2)
    assert bench.asked() == []


def test_the_loss_of_the_last_and_of_the_first_is_noticed_by_the_count():
    bench = Bench()
    bench.camera()
    bench.status(4)
    assert bench.asked() == [], "pictures of earlier flights are not asked for"
    bench.status(6)
    assert set(bench.asked()) == {4, 5}


def test_a_camera_for_which_the_autopilot_speaks_is_not_asked_for_pictures():
    sent = []
    watch = CameraWatch(1, sent.append, asks=False)
    watch.component = 100
    watch.on_time(10.0)
    assert {m.param1 for m in sent} == {259, 260, 261}


def test_an_autopilots_own_feedback_is_a_picture_without_a_name():
    bench = Bench()
    report = bench.hear(
        mavlink.MAVLink_camera_feedback_message(
            2_000_000, 1, 0, 5, 313622000, 1216155000, 24.0, 20.0, 0, 0, 0, 0, 0, 6
        ),
        1,
    )
    assert (report.index, report.file) == (5, None)
    assert bench.watch.component is None


def information(vendor=b"ACME", model=b"One\x1b", focal=24.0, sensor=(13.2, 8.8), pixels=(5472, 3648), flags=2):
    names = (list(vendor.ljust(32, b"\0")), list(model.ljust(32, b"\0")))
    return mavlink.MAVLink_camera_information_message(1, *names, 1, focal, *sensor, *pixels, 0, flags, 0, b"")


def storage(status=2, free=900.0):
    return mavlink.MAVLink_storage_information_message(1, 1, 1, status, 1000.0, 100.0, free, 1.0, 1.0)


def test_what_a_camera_is_gets_asked_until_it_is_known():
    bench = Bench()
    bench.camera()
    bench.asked(ASK_EVERY_S + 0.1)
    assert {m.param1 for m in bench.sent} == {259, 260, 261, 262}
    bench.hear(information())
    bench.hear(mavlink.MAVLink_camera_settings_message(1, 0))
    bench.hear(storage())
    bench.asked(ASK_EVERY_S + 0.1)
    assert {m.param1 for m in bench.sent} == {262}
    assert bench.watch.description.words() == ("ACME One, 24 mm, sensor 13.2 x 8.8 mm, 5472 x 3648 px, 900 MiB free")
    assert bench.watch.description.takes_images
    assert bench.watch.description.in_image_mode
    assert bench.watch.description.storage_ready


def test_a_camera_that_does_not_describe_itself_is_left_alone_after_a_while():
    bench = Bench()
    bench.camera()
    bench.asked(ASK_EVERY_S * 20)
    assert [m.param1 for m in bench.sent].count(259) == DESCRIPTION_TRIES


def test_what_is_impossible_in_a_description_is_not_known():
    bench = Bench()
    bench.camera()
    nan = float("nan")
    bench.hear(information(vendor=b"\xff\xfe", model=b"", focal=nan, sensor=(-1.0, nan), pixels=(0, 5), flags=0))
    bench.hear(storage(status=1, free=nan))
    found = bench.watch.description
    assert (found.focal_length_mm, found.sensor_mm, found.resolution_px, found.free_mib) == (None,) * 4
    assert found.takes_images is False
    assert found.storage_ready is False


def test_other_components_do_not_describe_it():
    bench = Bench()
    bench.camera()
    bench.hear(information(), component=101)
    assert bench.watch.description.name is None
