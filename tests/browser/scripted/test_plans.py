"""Plans on the screen: drawn, certified, asked for, cancelled."""

from __future__ import annotations

import io
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from PIL import Image
from playwright.async_api import Page, expect

from gcs.api.schemas import live

Drawn = Callable[[Page], Awaitable[None]]

pytestmark = pytest.mark.browser


async def test_plan_is_drawn_with_its_certificates(script: Any, told: Any, page: Page, drawn: Drawn) -> None:
    async with script.running():
        await page.goto(script.url)
        await expect(page.get_by_test_id("scene")).to_have_attribute("data-plan", "plan-1")
        await expect(page.get_by_test_id("clearance-budget")).to_contain_text("2.04 m")
        await expect(page.get_by_test_id("clearance-budget")).to_contain_text("asked 1.90 m")
        await expect(page.get_by_test_id("certificates")).to_contain_text("98.2 %")
        await drawn(page)
        shot = Image.open(io.BytesIO(await page.get_by_test_id("scene").screenshot())).convert("RGB")
        colours = {c for _, c in shot.getcolors(shot.width * shot.height) or []}
        near = lambda r, g, b: any(abs(r - x) + abs(g - y) + abs(b - z) < 40 for x, y, z in colours)  # noqa: E731
        assert near(0x3F, 0xB9, 0x50), "no seen samples"
        assert near(0xF0, 0x88, 0x3E), "no missed samples"
        assert near(0x4C, 0x9A, 0xFF), "no trajectory"


async def test_plan_from_text_and_cancel(script: Any, told: Any, page: Page) -> None:
    job = {"id": "job-1", "plan_id": "plan-2", "state": "running", "stage": "distance_field", "fraction": 0.25,
           "created_at": told.NOW, "finished_at": None}  # fmt: skip
    planning = told.plan_summary(id="plan-2", name="mine", state="planning", report=None, files=[], job=job)
    script.replies["POST /plans"] = {"plan": planning.model_dump(mode="json"), "job": job}
    script.replies["POST /plans/plan-2/cancel"] = planning
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("new-plan").click()
        await page.get_by_test_id("scenario-text").fill(
            "name: mine\nhome_m: [1, 2, 0]\nstructure: {sample: gantry-crane}\n"
        )
        await page.get_by_test_id("plan-text").click()
        await expect(page.get_by_test_id("plan-progress")).to_contain_text("distance field 25 %")
        scenario = {"name": "mine", "home_m": [1, 2, 0], "structure": {"sample": "gantry-crane"}}
        assert script.asked == [("POST /plans", {"scenario": scenario})]
        await page.get_by_test_id("cancel-plan").click()
        await script.push(
            live.PlanMessage(plan=told.plan_summary(id="plan-2", name="mine", state="cancelled", report=None))
        )
        await expect(page.get_by_test_id("plan-progress")).to_have_count(0)
        assert script.asked[-1][0] == "POST /plans/plan-2/cancel"


async def test_bad_scenario_is_told_with_its_field(script: Any, told: Any, page: Page) -> None:
    script.replies["POST /plans"] = script.problem(422, "Bad input", "this field is missing", "anchor")
    async with script.running():
        await page.goto(script.url)
        await page.get_by_test_id("new-plan").click()
        await page.get_by_test_id("scenario-text").fill("name: mine")
        await page.get_by_test_id("plan-text").click()
        await expect(page.get_by_test_id("plan-problem")).to_have_text("anchor: this field is missing")


async def test_layers_can_be_hidden_by_keyboard(script: Any, told: Any, page: Page) -> None:
    async with script.running():
        await page.goto(script.url)
        layer = page.get_by_test_id("layer-trajectory")
        await layer.focus()
        await page.keyboard.press("Space")
        await expect(layer).not_to_be_checked()
