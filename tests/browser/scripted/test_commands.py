"""Commands to a vehicle: deliberate, named, and shown for what the vehicle made of them."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.async_api import Page, expect

from gcs.api.schemas import live


def with_flight(script: Any, told: Any, **changes: Any) -> None:
    script.snapshot = script.snapshot.model_copy(update={"flights": [told.flight(**changes)]})


pytestmark = pytest.mark.browser


async def test_start_needs_the_name_and_every_accepted_failsafe(script: Any, told: Any, page: Page) -> None:
    with_flight(script, told, **told.PROVED)
    script.replies["GET /flights/flight-1/preflight"] = told.checks(
        ("datum", "ok", None), ("NAV_DLL_ACT", "needs_acceptance", "NAV_DLL_ACT")
    )
    script.replies["POST /flights/flight-1/start"] = told.flight(**told.FLYING)
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("start").click()
        go, name = page.get_by_test_id("confirm-go"), page.get_by_test_id("confirm-name")
        await expect(go).to_be_disabled()
        await name.fill(told.VEHICLE)
        await expect(go).to_be_disabled()
        await page.get_by_test_id("accept-NAV_DLL_ACT").check()
        await expect(go).to_be_enabled()
        await name.fill("px4-2")
        await expect(go).to_be_disabled()
        await name.press("Enter")
        assert script.asked == []
        await name.fill(told.VEHICLE)
        await name.press("Enter")
        await expect(page.get_by_test_id("flight-state")).to_have_text("flying")
        assert script.asked == [("POST /flights/flight-1/start", {"confirm": told.VEHICLE, "accept": ["NAV_DLL_ACT"]})]


async def test_refused_check_is_shown_and_start_not_asked(script: Any, told: Any, page: Page) -> None:
    with_flight(script, told, **told.PROVED)
    script.replies["GET /flights/flight-1/preflight"] = told.checks(("datum", "refused", None))
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("start").click()
        await expect(page.locator("[data-testid=check][data-state=refused]")).to_contain_text("what datum says")
        await expect(page.get_by_test_id("confirm-panel")).to_have_count(0)
        assert script.asked == []


async def test_upload_shows_proof_only_when_proved(script: Any, told: Any, page: Page) -> None:
    script.replies["POST /flights/flight-1/upload"] = told.flight(state="uploading", actions=[])
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("prepare").click()
        await page.get_by_test_id("upload").click()
        proof = page.get_by_test_id("proof")
        await expect(proof).to_have_text("not proved yet")
        await script.push(live.UploadMessage(flight_id="flight-1", phase="sending", fraction=0.5))
        await expect(page.get_by_test_id("upload-progress")).to_contain_text("sending 50 %")
        await expect(page.get_by_test_id("scene")).to_have_attribute("data-on-vehicle", "unknown")
        script.replies["GET /flights/flight-1/on-vehicle"] = told.on_vehicle()
        await script.push(live.FlightMessage(flight=told.flight(**told.PROVED)))
        await expect(proof).to_have_text("proved on the vehicle 10:01:00")
        await expect(page.get_by_test_id("scene")).to_have_attribute("data-on-vehicle", "4")
        differing = told.on_vehicle(equal=False, differences=["item 3 is missing"], state="failed")
        script.replies["GET /flights/flight-1/on-vehicle"] = differing
        await script.push(live.FlightMessage(flight=told.flight(state="upload_failed", actions=["upload"])))
        await expect(proof).to_have_text("differs: item 3 is missing")


async def test_land_must_be_held(script: Any, told: Any, page: Page) -> None:
    with_flight(script, told, **told.FLYING)
    script.replies["POST /flights/flight-1/land"] = told.flight(
        state="landing", proved=True, actions=["pause", "return"]
    )
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("land").click()
        await page.get_by_test_id("land").hover()
        await page.mouse.down()
        await expect(page.get_by_test_id("flight-state")).to_have_text("landing")
        await page.mouse.up()
        assert script.asked == [("POST /flights/flight-1/land", {"confirm": None})]


async def test_refusal_is_told_in_its_own_words(script: Any, told: Any, page: Page) -> None:
    with_flight(script, told, **told.FLYING)
    script.replies["POST /flights/flight-1/pause"] = script.problem(409, "Refused", "the pilot has taken over")
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("pause").click()
        await expect(page.get_by_test_id("action-problem")).to_have_text("the pilot has taken over")
        await expect(page.get_by_test_id("log")).to_contain_text("the pilot has taken over")
        await expect(page.get_by_test_id("flight-state")).to_have_text("flying")


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080)])
async def test_no_command_is_out_of_sight(script: Any, told: Any, page: Page, size: tuple[int, int]) -> None:
    """Pause, return and land stay inside the flight bar and nothing covers them, in every state of a flight."""
    await page.set_viewport_size({"width": size[0], "height": size[1]})
    script.replies["GET /flights/flight-1/on-vehicle"] = told.on_vehicle()
    script.replies["GET /flights/flight-1/preflight"] = told.checks(
        *[(f"check_{i}", "needs_acceptance", f"P{i}") for i in range(16)]
    )
    with_flight(script, told)
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("check").click()
        await expect(page.get_by_test_id("preflight")).to_be_visible()
        figures = {"viewpoints_reached": 4, "images_received": 4, "max_cross_track_m": 11.25}
        for state in ("created", "uploading", "uploaded", "flying", "held", "completed"):
            changed = told.flight(state=state, proved=True, started_at=told.NOW, **figures)
            await script.push(live.FlightMessage(flight=changed))
            await expect(page.get_by_test_id("flight-bar")).to_have_attribute("data-state", state)
            bar = await page.get_by_test_id("flight-bar").bounding_box()
            assert bar
            assert bar["y"] + bar["height"] <= size[1]
            for name in ("pause", "return", "land"):
                button = await page.get_by_test_id(name).bounding_box()
                assert button
                assert bar["x"] <= button["x"], (state, name)
                assert button["x"] + button["width"] <= bar["x"] + bar["width"], (state, name)
                middle = {"x": button["x"] + button["width"] / 2, "y": button["y"] + button["height"] / 2}
                on_top = await page.evaluate(
                    "({x, y}) => document.elementFromPoint(x, y)?.closest('[data-testid]')?.dataset.testid", middle
                )
                assert on_top == name, (state, name)
