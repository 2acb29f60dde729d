import itertools
import random

from gcs.mavlink.id_clash import KEPT_S, IdClashWatch


def hear(watch, numbers, *, way="radio", every_s=0.02, start_s=100.0):
    for i, (earlier, number) in enumerate(itertools.pairwise(numbers)):
        if (number - earlier) % 256 != 1:
            watch.jump(way, earlier % 256, number % 256, start_s + i * every_s)
    return start_s + len(numbers) * every_s


def test_one_vehicle_over_a_bad_link_is_one_vehicle():
    rng = random.Random(1)
    for trial in range(50):
        watch = IdClashWatch()
        numbers = [n for n in range(1000) if rng.random() > rng.choice((0.0, 0.3, 0.6))]
        numbers = sorted(numbers, key=lambda n: n + rng.random() * 8)  # late packets overtake each other
        if trial % 2:
            numbers += list(range(7, 400))  # a reboot starts anew
        now = hear(watch, numbers)
        assert watch.reason(now) is None


def test_two_counters_in_turns_are_two_vehicles_even_where_half_is_lost():
    rng = random.Random(2)
    for loss in (0.0, 0.3, 0.5):
        watch = IdClashWatch()
        one, two = iter(range(10, 10_000)), iter(range(150, 10_000))
        numbers = [next(one if rng.random() < 0.5 else two) for _ in range(400)]
        now = hear(watch, [n for n in numbers if rng.random() >= loss])
        assert "two counters" in watch.reason(now)


def test_the_same_counters_on_two_ways_are_one_vehicle():
    watch = IdClashWatch()
    for i in range(0, 500, 3):
        watch.jump("radio", i % 256, (i + 3) % 256, i * 0.02)
        watch.jump("lte", (i + 90) % 256, (i + 93) % 256, i * 0.02)
    assert watch.reason(10.0) is None


def test_a_reboot_is_no_clash_and_clocks_in_turns_are():
    watch = IdClashWatch()
    for i in range(60):
        watch.clock(500.0 + i * 0.1, i * 0.1)
    for i in range(60):
        watch.clock(i * 0.1, 6.0 + i * 0.1)
    assert watch.reason(12.0) is None
    for i in range(10):
        watch.clock((500.0 if i % 2 else 20.0) + i * 0.1, 12.0 + i * 0.1)
    assert watch.reason(13.0) == "clocks 480 s apart are heard in turns"


def test_late_messages_of_a_sped_up_simulation_are_no_clash():
    watch = IdClashWatch()
    for i in range(100):
        late = 0.2 if i % 2 else 0.0
        watch.clock(50.0 * (i * 0.1 - late), i * 0.1, rate=50.0)
    assert watch.reason(10.0) is None


def test_two_units_clash_until_one_is_silent_for_a_while():
    watch = IdClashWatch()
    watch.unit("radio", "aa", 1.0)
    watch.unit("radio", "aa", 2.0)
    assert watch.reason(2.0) is None
    watch.unit("lte", "bb", 3.0)
    assert watch.reason(3.0) == "units aa and bb answer"
    assert watch.reason(3.0 + KEPT_S + 0.1) is None
    watch.unit("lte", "bb", 3.0 + KEPT_S)
    assert watch.reason(3.0 + KEPT_S + 0.2) is None


def test_a_strangers_packets_that_all_have_one_number_are_no_second_count():
    rng = random.Random(4)
    watch = IdClashWatch()
    real = iter(range(100, 10_000))
    now = hear(watch, [next(real) if rng.random() < 0.5 else 0 for _ in range(1000)])
    assert watch.reason(now) is None
