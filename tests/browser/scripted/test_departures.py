"""Departures from the plan, the plan that is offered for what was skipped, and the links of a vehicle."""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Page, expect

from gcs.api.schemas import live

pytestmark = pytest.mark.browser

GOOD = {"rejects_unsigned": True, "good": 5120, "unsigned": 0, "wrong_key": 0, "repeated": 0, "past": 0}
WAYS = [
    {
        "url": "serial:/dev/ttyUSB0:57600", "peer": "serial", "used": True, "loss": 0.02, "round_trip_s": 0.31,
        "age_s": 0.1, "signing": {**GOOD, "problem": None, "rotated_at": "2026-11-22T09:30:00Z"},
    },
    {
        "url": "udpin:0.0.0.0:14550", "peer": "10.0.0.7:14550", "used": False, "loss": 0.2, "round_trip_s": 0.06,
        "age_s": 2.3, "signing": {**GOOD, "unsigned": 12, "problem": "unsigned packets come in and are refused"},
    },
]  # fmt: skip


@pytest.fixture
def departed(script: Any, told: Any) -> Any:
    """A flight that is over, left its plan once, and skipped V2."""
    over = told.flight(state="incomplete", actions=[], viewpoints_reached=3, started_at=told.NOW, ended_at=told.NOW)
    vehicle = told.vehicle(ways=WAYS, id_clash="clocks 30 s apart are heard in turns")
    script.snapshot = script.snapshot.model_copy(update={"flights": [over], "vehicles": [vehicle]})
    script.replies |= {
        "GET /flights/flight-1/replans": [told.replan()],
        "GET /flights/flight-1/offers": [told.offer()],
        "GET /flights/flight-1/on-vehicle": told.on_vehicle(),
        "POST /offers/offer-1/refuse": told.offer(state="refused", decided_at=told.NOW),
        "POST /offers/offer-1/accept": told.offer(state="accepted", decided_at=told.NOW, plan_id="plan-2"),
    }
    return script


async def test_a_departure_is_shown_beside_what_was_planned(
    departed: Any, told: Any, page: Page, drawn: Callable[[Page], Awaitable[None]], tmp_path: Path
) -> None:
    async with departed.running():
        await page.goto(departed.url)
        replan = page.get_by_test_id("replan")
        await expect(replan).to_contain_text("8.7 m in 3.5 s, from 0:30 to 0:34 of the plan")
        await expect(replan).to_contain_text("11.7 m in 4.5 s")
        await expect(replan).to_contain_text("moving at 1.0 m/s, 1.6 m wide")
        await expect(replan).to_contain_text("skipped")
        await drawn(page)
        await page.screenshot(path=Path(os.environ.get("GCS_SCREENSHOTS", tmp_path)) / "departure.png")
        strange = told.replan(id=2, number=2, chain="unknown", plan_hash="ff" * 32, left_out=None)
        await departed.push(live.ReplanMessage(replan=strange))
        await expect(page.locator("[data-testid=replan][data-chain=unknown]")).to_contain_text(
            "does not know (ffffffff"
        )


async def test_who_leads_and_why_the_plan_is_left_is_shown_with_the_flight(
    departed: Any, told: Any, page: Page
) -> None:
    flying = told.flight(**{**told.FLYING, "mode": "companion", "plan_time_s": None})
    departed.snapshot = departed.snapshot.model_copy(update={"flights": [flying], "leases": [told.lease()]})
    async with departed.running():
        await page.goto(departed.url)
        lease = page.get_by_test_id("lease")
        await expect(lease).to_contain_text("the companion leads")
        await expect(lease).to_contain_text("on the plan")
        await expect(lease).to_contain_text("0.1 s old")
        await expect(lease).to_contain_text("92 %")
        away = told.lease(away="a moving obstacle", reports_pending=2, odometry_quality=None, lidar_age_s=1.9)
        await departed.push(live.LeaseMessage(lease=away))
        for words in ("off the plan: a moving obstacle", "2 on board", "none", "1.9 s old"):
            await expect(lease).to_contain_text(words)
        await departed.push(live.LeaseMessage(lease=told.lease(state="taken_over", text="the pilot moves the sticks")))
        await expect(lease).to_contain_text("somebody else has the vehicle")
        await expect(lease).to_contain_text("the pilot moves the sticks")
        await expect(lease).to_have_attribute("data-stale", "true")  # it is not told of any more
        await expect(lease).to_contain_text("the companion is not heard")
        report = page.get_by_test_id("flight-report")
        await expect(report).to_have_attribute("href", "/api/flights/flight-1/report.html")


async def test_an_offer_is_refused_and_another_is_accepted(departed: Any, told: Any, page: Page) -> None:
    async with departed.running():
        await page.goto(departed.url)
        offer = page.get_by_test_id("offer")
        await expect(offer).to_contain_text("84 m in 1:01")
        await page.get_by_test_id("refuse-offer").click()
        await expect(offer).to_have_attribute("data-state", "refused")
        await expect(page.get_by_test_id("ask-for-offer")).to_be_visible()
        departed.snapshot = departed.snapshot.model_copy(
            update={"plans": [told.plan_summary(), told.plan_summary(id="plan-2", created_at="2026-11-22T09:00:00Z")]}
        )
        await departed.push(live.OfferMessage(offer=told.offer()))
        await page.get_by_test_id("accept-offer").click()
        await expect(offer).to_have_attribute("data-state", "accepted")
        assert [what for what, _ in departed.asked] == ["POST /offers/offer-1/refuse", "POST /offers/offer-1/accept"]


async def test_links_are_shown_with_their_quality_and_signing_and_a_clash_is_said(departed: Any, page: Page) -> None:
    async with departed.running():
        await page.goto(departed.url)
        used, spare = page.locator("[data-testid=way][data-used=true]"), page.locator("[data-used=false]")
        await expect(used).to_contain_text("signed · key rotated 09:30:00")
        await expect(used).to_contain_text("2 % lost · 310 ms")
        await expect(spare).to_contain_text("12 refused")
        await expect(spare).to_contain_text("unsigned packets come in and are refused")
        await expect(page.get_by_test_id("id-clash")).to_contain_text("Two vehicles use system id 1")
