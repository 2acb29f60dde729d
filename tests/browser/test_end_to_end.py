"""The main job by the dashboard alone: plan the sample crane, upload with proof, start, watch the flight to its end."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from PIL import Image
from playwright.async_api import Page, expect

pytestmark = [pytest.mark.browser, pytest.mark.system]

PLANNING_MS = 180_000
TRANSFER_MS = 60_000
FLIGHT_MS = 300_000
VEHICLE = "px4-1"
COLOURS = {"trajectory": (0x4C, 0x9A, 0xFF), "on vehicle": (0xD4, 0x6F, 0xF0), "flown": (0xF2, 0xCC, 0x4C)}


def shows(picture: Image.Image, colour: tuple[int, int, int]) -> bool:
    """Whether a screenshot has pixels of about this colour."""
    found = picture.convert("RGB").getcolors(picture.width * picture.height) or []
    return any(sum(abs(a - b) for a, b in zip(c, colour, strict=True)) < 45 for _, c in found)


async def test_crane_is_planned_flown_and_watched(
    real_station: str, simulated_vehicle: str, page: Page, drawn: Callable[[Page], Awaitable[None]], tmp_path: Path
) -> None:
    folder = Path(os.environ.get("GCS_SCREENSHOTS", tmp_path))
    await page.goto(real_station)
    await page.get_by_test_id("link-url").fill(simulated_vehicle)
    await page.get_by_test_id("add-link").click()
    await expect(page.get_by_test_id("vehicle-name")).to_have_text(VEHICLE, timeout=30_000)

    await page.get_by_test_id("plan-sample").click()
    plan = page.get_by_test_id("plan")
    await expect(plan).to_have_attribute("data-state", "ready", timeout=PLANNING_MS)
    await expect(page.get_by_test_id("clearance-budget")).to_contain_text("asked 1.90 m")
    await expect(page.get_by_test_id("scene")).to_have_attribute("data-plan", re.compile(".+"))
    await drawn(page)
    await page.screenshot(path=folder / "planned.png")

    await page.get_by_test_id("prepare").click()
    await expect(page.get_by_test_id("checks-summary")).to_be_visible(timeout=TRANSFER_MS)
    await expect(page.get_by_test_id("scene")).to_have_attribute("data-on-vehicle", "unknown")
    await page.get_by_test_id("upload").click()
    await expect(page.get_by_test_id("proof")).to_contain_text("proved on the vehicle", timeout=TRANSFER_MS)
    await expect(page.get_by_test_id("scene")).to_have_attribute("data-on-vehicle", re.compile(r"\d+"))

    await page.get_by_test_id("start").click()
    await page.get_by_test_id("confirm-name").fill(VEHICLE, timeout=TRANSFER_MS)
    await page.get_by_test_id("confirm-go").click()
    state = page.get_by_test_id("flight-state")
    await expect(state).to_have_text("flying", timeout=TRANSFER_MS)
    await expect(page.get_by_test_id("images-received")).to_have_text(re.compile("^[1-9]"), timeout=FLIGHT_MS)
    await drawn(page)
    await page.screenshot(path=folder / "flying.png")

    await expect(state).to_have_text("completed", timeout=FLIGHT_MS)
    await expect(page.get_by_test_id("viewpoints-reached")).to_have_text("18/18")
    await expect(page.get_by_test_id("images-received")).to_have_text("18/18")
    await expect(page.locator("[data-testid=image][data-state=stored]")).to_have_count(18)
    await expect(page.get_by_test_id("replan")).to_have_count(1)
    await drawn(page)
    await page.screenshot(path=folder / "flown.png")
    scene = Image.open(io.BytesIO(await page.get_by_test_id("scene").screenshot()))
    assert [name for name, colour in COLOURS.items() if not shows(scene, colour)] == []
    await page.locator("[data-testid=image][data-state=stored] button").first.click()
    await expect(page.locator("[data-testid=image-dialog] img")).not_to_have_js_property("naturalWidth", 0)
