import base64
import time

import numpy as np
import pytest

pytest.importorskip("viser")

from rigs.scene.scene_camera import own_camera
from tomo.draw.rig.rig_scene import symbol_length
from tomo.view import Viewer
from tomo.view.volume_layer import viewpoint_of

SIZE = (760, 560)
SECONDS = 60


class Page:
    """A viewer's page in the browser."""

    def __init__(self, browser, viewer):
        self.browser, self.viewer = browser, viewer
        browser.problems()
        browser.command("Network.enable")
        browser.command(
            "Emulation.setDeviceMetricsOverride",
            width=SIZE[0], height=SIZE[1], deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        browser.command("Page.navigate", url=viewer.url)
        self.until(lambda: self.client is not None)
        self.client_settled()

    @property
    def client(self):
        return next(iter(self.viewer.server.get_clients().values()), None)

    def until(self, found):
        end = time.monotonic() + SECONDS
        while not found():
            assert time.monotonic() < end
            time.sleep(0.1)

    def client_settled(self):
        """Wait until the worker is idle and two pictures of the page are the same."""
        assert self.viewer.worker.wait(SECONDS)
        before = self.picture()
        while True:
            time.sleep(0.4)
            after = self.picture()
            if np.array_equal(before, after):
                return
            before = after

    def picture(self):
        import cv2

        data = self.browser.command("Page.captureScreenshot", format="png")["data"]
        return cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)

    def changed_from(self, before):
        """Wait for another picture left of the controls."""
        part = np.s_[:, : SIZE[0] // 2]
        self.until(lambda: np.abs(self.picture()[part].astype(int) - before[part]).max() > 20)

    def press(self, x, y):
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.browser.command(
                "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                clickCount=int(kind != "mouseMoved"),
            )  # fmt: skip

    def press_button(self, label):
        x, y = self.browser.evaluate(
            f"""
            const button = [...document.querySelectorAll("button")].find(
              (one) => one.textContent.trim() === "{label}");
            const box = button.getBoundingClientRect();
            return [box.left + box.width / 2, box.top + box.height / 2];
            """
        )
        self.press(x, y)

    def slide(self, label, key, times):
        """Move a slider by keys."""
        self.browser.evaluate(
            f"""
            const label = [...document.querySelectorAll("label")].find(
              (one) => one.textContent.trim() === "{label}");
            let row = label;
            while (!row.querySelector("[role=slider]")) row = row.parentElement;
            row.querySelector("[role=slider]").focus();
            """
        )
        for _ in range(times):
            for kind in ("keyDown", "keyUp"):
                self.browser.command("Input.dispatchKeyEvent", type=kind, key=key, code=key)

    def text(self):
        return self.browser.evaluate("return document.body.innerText;")


@pytest.fixture
def page(browser, content):
    viewer = Viewer(content, port=18080)
    yield Page(browser, viewer)
    browser.command("Page.navigate", url="about:blank")
    viewer.stop()
    browser.command("Network.disable")


def test_a_film_is_drawn_and_follows_its_controls_and_asks_no_other_host(page, content):
    first = page.picture()
    scene = first[:, : SIZE[0] // 2].reshape(-1, 3)
    assert len(np.unique(scene, axis=0)) > 50
    assert "100 % is" in page.text()
    assert "start" in page.text()

    page.slide("threshold %", "ArrowRight", 40)
    page.changed_from(first)
    assert page.viewer.controls.threshold.value == 35

    page.client_settled()
    second = page.picture()
    page.slide("frame", "ArrowRight", 2)
    page.changed_from(second)
    page.until(lambda: "end" in page.text())
    assert page.viewer.place == 2

    viewer, client = page.viewer, page.client
    page.client_settled()
    third = page.picture()
    viewer.controls.along.value = "maximum"
    page.changed_from(third)

    page.client_settled()
    page.press_button("cameras")
    page.client_settled()
    view = viewpoint_of(client.camera, viewer._world, SIZE[1])
    pixels = {
        one.name: view.project(
            one.position + symbol_length(content.rig, content.target) * one.R[2]
        )
        for one in map(own_camera, content.rig)
    }
    inside = {
        name: uv[0] for name, uv in pixels.items()
        if (uv[0] > 5).all() and uv[0][0] < SIZE[0] - 340 and uv[0][1] < SIZE[1] - 5
    }  # fmt: skip
    name, (x, y) = next(iter(inside.items()))
    page.press(x, y)
    page.until(lambda: viewer.comparison is not None)
    assert viewer.comparison.name == name
    assert viewer.comparison.view.relative_residual < 1e-4
    page.until(lambda: "relative residual" in page.text())

    asked = [
        event["params"]["request"]["url"]
        for event in page.browser.events
        if event.get("method") == "Network.requestWillBeSent"
    ]
    strangers = [
        url for url in asked
        if not url.startswith(("data:", "blob:", viewer.url, "about:"))
    ]  # fmt: skip
    assert viewer.url + "/" in asked
    assert strangers == []
    assert page.browser.problems() == []
