"""What is shown is what is known: fresh, old, unknown, flown."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from playwright.async_api import Page, expect

from gcs.api.schemas import flights, live, vehicles


def with_flight(script: Any, told: Any, **changes: Any) -> None:
    script.snapshot = script.snapshot.model_copy(update={"flights": [told.flight(**changes)]})


pytestmark = pytest.mark.browser


async def keep_telling(script: Any, vehicle: vehicles.VehicleInfo) -> None:
    """Telemetry as a live vehicle gives it, until cancelled."""
    while True:
        await script.push(live.TelemetryMessage(vehicle=vehicle))
        await asyncio.sleep(0.3)


async def test_unknown_and_old_values_look_so(script: Any, told: Any, page: Page) -> None:
    vehicle = told.vehicle(ready_to_arm=None, gps_fix=told.reading(3, 42.0, stale=True))
    async with script.running():
        await page.goto(script.url)
        telling = asyncio.create_task(keep_telling(script, vehicle))
        await expect(page.get_by_test_id("ready")).to_have_text("unknown")
        await expect(page.get_by_test_id("fix")).to_have_attribute("data-stale", "true")
        await expect(page.get_by_test_id("vehicle-panel")).to_contain_text("42 s ago")
        await expect(page.get_by_test_id("armed")).to_have_attribute("data-stale", "false")
        await expect(page.get_by_test_id("vehicle-link")).to_have_text("heard")
        await expect(page.get_by_test_id("link-quality")).to_have_text("98 % · 87/s · 42 ms")
        telling.cancel()
        # The station is there but says nothing more of the vehicle: everything of it grows old by itself.
        await expect(page.get_by_test_id("armed")).to_have_attribute("data-stale", "true")
        await expect(page.get_by_test_id("vehicle-link")).to_have_text("not heard")
        await expect(page.get_by_test_id("connection")).to_have_text("station live")


async def test_lost_station_is_said_at_once_and_found_again(script: Any, told: Any, page: Page) -> None:
    with_flight(script, told, **told.FLYING)
    async with script.running():
        await page.goto(script.url)
        await expect(page.get_by_test_id("connection")).to_have_text("station live")
        await expect(page.get_by_test_id("pause")).to_be_enabled()
    await expect(page.get_by_test_id("lost-banner")).to_be_visible()
    await expect(page.get_by_test_id("armed")).to_have_attribute("data-stale", "true")
    await expect(page.get_by_test_id("pause")).to_be_disabled()
    asked = list(script.asked)
    async with script.running():
        await expect(page.get_by_test_id("connection")).to_have_text("station live", timeout=20_000)
        await expect(page.get_by_test_id("lost-banner")).to_have_count(0)
        assert script.asked == asked, "a reconnect commanded something"


async def test_flight_is_followed(script: Any, told: Any, page: Page) -> None:
    with_flight(script, told, **told.FLYING)
    script.replies["GET /flights/flight-1/on-vehicle"] = told.on_vehicle()
    async with script.running():
        await page.goto(script.url)
        await expect(page.get_by_test_id("scene")).to_have_attribute("data-on-vehicle", "4")
        track = [flights.TrackSample(at_s=i, position_m=(-7.0, -4.0, 0.5 * i), cross_track_m=0.1) for i in range(30)]
        said = vehicles.VehicleMessage(number=1, vehicle=told.VEHICLE, at=told.NOW, severity=4, text="Low wind")
        await script.push(
            live.TrackMessage(flight_id="flight-1", points=track[:20]),
            live.TrackMessage(flight_id="flight-1", points=track[10:]),
            live.ImageMessage(image=told.image(0, "announced")),
            live.ImageMessage(image=told.image(0)),
            live.ImageMessage(image=told.image(1, "fetching")),
            live.ReplanMessage(replan=told.replan()),
            live.VehicleTextMessage(message=said),
            live.FlightMessage(flight=told.flight(**told.FLYING, viewpoints_reached=2, images_received=1)),
        )
        await expect(page.get_by_test_id("scene")).to_have_attribute("data-flown", "30")
        await expect(page.get_by_test_id("viewpoints-reached")).to_have_text("2/4")
        await expect(page.get_by_test_id("images-received")).to_have_text("1/4")
        await expect(page.get_by_test_id("replan")).to_contain_text("bird")
        await expect(page.get_by_test_id("log")).to_contain_text("Low wind")
        await expect(page.get_by_test_id("image")).to_have_count(2)
        await page.locator("[data-testid=image][data-state=stored]").click()
        await expect(page.get_by_test_id("image-dialog")).to_contain_text("0000beef")
        await expect(page.locator("[data-testid=image-dialog] img")).to_have_js_property("naturalWidth", 320)
