"""Reports against a plan that goes up, out to the east, back on the same way, and down again."""

import pytest

from gcs.services.replan_difference import Chain, differences
from gcs.storage.records import ReplanRecord, ViewpointFateName, ViewpointFateRecord

PLAN, ONE, TWO, THREE = "ab" * 32, "01" * 32, "02" * 32, "03" * 32
AROUND = ((3.0, 0.0, 10.0), (4.0, 2.0, 10.0), (5.0, 0.0, 10.0))
SKIPPED = (ViewpointFateRecord(0, ViewpointFateName.SKIPPED),)


def report(number=1, before=PLAN, after=ONE, path=AROUND, left=100.0, back=102.0, viewpoints=(), boot=7):
    return ReplanRecord(
        number, "f", 1, boot, number, "", before, "", -1, left, back, path, plan_hash_after=after, viewpoints=viewpoints
    )


def compared(plan, *reports, stored=None):
    numbers = {(r.boot_id, r.number) for r in reports} | (stored or set())
    return differences(plan, PLAN, reports, lambda boot, number: (boot, number) in numbers)


def x(plan, time_s):
    return plan.trajectory.value(time_s)[0]


def test_the_piece_left_out_is_the_one_between_leaving_and_coming_back(small_plan):
    (view,) = compared(small_plan, report())
    piece = view.left_out
    assert (x(small_plan, piece.from_s), x(small_plan, piece.to_s)) == pytest.approx((3, 5), abs=0.2)
    assert 6 < piece.from_s < piece.to_s < 11  # on the way out
    assert piece.length_m == pytest.approx(2.0, abs=0.3)
    assert piece.path_m[0] == pytest.approx([3, 0, 10], abs=0.2)
    assert view.flown_length_m == pytest.approx(2 * 5**0.5)
    assert view.flown_duration_s == 2.0


def test_the_way_back_over_the_same_place_is_told_from_the_way_out(small_plan):
    backwards = AROUND[::-1]
    (view,) = compared(small_plan, report(path=backwards))
    assert 11 < view.left_out.from_s < view.left_out.to_s < 16
    out, back = compared(small_plan, report(), report(2, ONE, TWO, path=backwards))
    assert out.left_out.to_s <= back.left_out.from_s


def test_a_skipped_viewpoint_lies_in_the_piece_that_was_left_out(small_plan):
    """It was left and joined at one place: nothing but the viewpoint tells that the piece goes by it."""
    (view,) = compared(small_plan, report(path=((7.0, 0.0, 10.0),) * 2, viewpoints=SKIPPED))
    (viewpoint,) = small_plan.viewpoints
    assert view.left_out.from_s <= viewpoint.time_s <= view.left_out.to_s
    assert view.viewpoint_names == (viewpoint.name,)


def test_waiting_in_place_leaves_nothing_out(small_plan):
    (view,) = compared(small_plan, report(path=((4.0, 0.0, 10.0),) * 2, back=100.4))
    assert view.left_out.length_m < 0.5
    assert (view.flown_length_m, view.flown_duration_s) == (0.0, pytest.approx(0.4))


def test_without_coming_back_the_rest_of_the_plan_is_left_out(small_plan):
    (view,) = compared(small_plan, report(back=None))
    assert view.left_out.to_s == pytest.approx(small_plan.trajectory.duration_s)
    assert view.flown_duration_s is None


def test_the_chain_of_plans_is_followed_from_report_to_report(small_plan):
    first, second, third = report(), report(2, ONE, TWO), report(3, TWO, THREE)
    assert [v.chain for v in compared(small_plan, first, second, third)] == [Chain.KNOWN] * 3
    gap = compared(small_plan, first, third)
    assert [v.chain for v in gap] == [Chain.KNOWN, Chain.GAP]
    assert gap[1].left_out is not None
    late = compared(small_plan, first, third, second)
    assert [(v.record.number, v.chain) for v in late] == [(n, Chain.KNOWN) for n in (1, 2, 3)]


def test_a_plan_that_nobody_knows_is_not_compared_nor_what_follows_from_it(small_plan):
    strange, next_ = report(1, "ff" * 32, ONE), report(2, ONE, TWO)
    views = compared(small_plan, strange, next_)
    assert [v.chain for v in views] == [Chain.UNKNOWN] * 2
    assert [v.left_out for v in views] == [None, None]


def test_the_report_before_may_be_of_another_flight(small_plan):
    (view,) = compared(small_plan, report(5, "ff" * 32, ONE), stored={(7, 4)})
    assert view.chain is Chain.UNKNOWN
    (view,) = compared(small_plan, report(5, "ff" * 32, ONE))
    assert view.chain is Chain.GAP


def test_a_report_without_a_path_and_of_a_viewpoint_that_is_not_there_is_shown_too(small_plan):
    unheard_of = (ViewpointFateRecord(99, ViewpointFateName.SKIPPED),)
    (view,) = compared(small_plan, report(path=(), viewpoints=unheard_of))
    assert (view.left_out, view.flown_length_m, view.viewpoint_names) == (None, 0.0, (None,))
