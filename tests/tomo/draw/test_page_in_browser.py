import json

import numpy as np
import pytest

from rigs import Camera, Distortion, Rig, look_at, ring
from rigs.check import check_rig
from tomo.draw import Scene, write_html
from tomo.draw.rig.camera_view import camera_views
from tomo.draw.rig.rig_page import check_table, coverage_maps, coverage_scene
from tomo.draw.rig.rig_scene import Target, rig_scene, up_of
from tomo.draw.rig.thumbnails import image_scene
from tomo.draw.stage import Shown
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((12, 20, 12), 1.0, (3.0, 0.0, -2.0))
HOSTILE = "<img src=x onerror=alert(1)> & 'x'"

SHOWN = """
const boxes = [...document.querySelectorAll(".names span:not(.number)")]
  .filter((span) => span.style.visibility === "visible")
  .map((span) => { const b = span.getBoundingClientRect();
                   return [span.textContent, b.left, b.top, b.right, b.bottom]; });
"""


def lens(name, position, model, coefficients, focal):
    R, t = look_at(position, GRID.center)
    K = [[focal, 0, 300.0], [0, focal, 250.0], [0, 0, 1]]
    return Camera(name, (640, 480), K, Distortion(model, coefficients), R, t)


@pytest.fixture(scope="module")
def lenses():
    return Rig(
        (
            lens("pinhole", (150.0, 20.0, 0.0), "none", (), 900.0),
            lens("bent", (0.0, 10.0, 150.0), "brown", (-0.25, 0.08, 1e-3, -2e-3), 500.0),
            lens("wide", (-90.0, 0.0, 90.0), "fisheye", (0.02, -0.01, 0.0, 0.0), 300.0),
            lens(HOSTILE, (-50.0, 60.0, -90.0), "none", (), 700.0),
            lens("folded", (80.0, -40.0, -80.0), "brown", (-0.25, 0, 0, 0), 120.0),
        )
    )


@pytest.fixture(scope="module")
def page(lenses, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "rig.html"
    images = {
        name: np.uint8(np.linspace(0, 255, 64 * 48)).reshape(48, 64) for name in lenses.names[:2]
    }
    check = check_rig(lenses, GRID)
    volume = np.exp(-((GRID.centers() - GRID.center) ** 2).sum(axis=-1) / 9).astype(np.float32)
    scene = rig_scene(lenses, GRID) + coverage_scene(coverage_maps(check))
    scene += image_scene(lenses, Target.of(lenses, GRID), images)
    write_html(
        path,
        scene,
        title="five lenses",
        up=up_of(lenses),
        grid=GRID,
        shown=Shown((Volume(volume, GRID),)),
        views=camera_views(lenses, GRID, images),
        tables=[check_table(check)],
    )
    return path


@pytest.fixture(scope="module")
def opened(open_page, page):
    return open_page(page, (1000, 620))


def test_every_layer_switches_what_it_names_and_maps_replace_each_other(opened):
    found = opened.evaluate(
        """
        const state = () => Object.fromEntries([...document.querySelectorAll("[data-layer]")].map(
          (box) => [box.dataset.layer, box.checked]));
        const press = async (name) => {
          document.querySelector(`[data-layer="${name}"]`).click();
          await pause(20);
          return [state(), [...stages[0].visible()]];
        };
        const out = { first: [state(), [...stages[0].visible()]] };
        for (const name of Object.keys(state())) out[name] = await press(name);
        return out;
        """
    )
    names = list(found["first"][0])
    expected = {"cameras", "names", "images", "sight lines", "box", "clicked rays"}
    planes = {"light", "surfaces", "plane x", "plane y", "plane z"}
    assert expected | planes | {"map: views", "map: details"} <= set(names)
    state = dict(found["first"][0])
    for name in names:
        state[name] = not state[name]
        if name.startswith("map: ") and state[name]:
            state |= {other: False for other in names if other.startswith("map") and other != name}
        if state[name] and name.startswith(("map: ", "plane ", "surfaces")):
            state["light"] = False  # it would change their colours
        checked, drawn = found[name]
        assert checked == state
        assert set(drawn) == {layer for layer in names if checked[layer]}
    assert sum(checked[name] for name in names if name.startswith("map: ")) == 1


def test_what_a_layer_switches_off_is_not_drawn(opened):
    lit = opened.evaluate(
        """
        const stage = stages[0], out = [];
        const bright = () => {
          stage.rest();
          stage.now();
          const { gl, canvas } = stage.light;
          const bytes = new Uint8Array(4 * canvas.width * canvas.height);
          gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
          return bytes.filter((value, k) => k % 4 < 3 && value > 40).length;
        };
        const before = new Set(stage.visible());
        for (const name of stage.layers.keys()) stage.choose(name, false);
        out.push(bright());
        for (const name of ["cameras", "map: views", "light", "plane x"]) {
          stage.choose(name, true);
          out.push(bright());
          stage.choose(name, false);
        }
        for (const name of before) stage.choose(name, true);
        return out;
        """
    )
    assert lit[0] == 0
    assert min(lit[1:]) > 50


def test_a_clicked_pixel_s_ray_is_the_camera_s_own(opened, lenses):
    wanted = {
        name: np.random.default_rng(len(name)).uniform([5, 5], [635, 475], (6, 2)).tolist()
        for name in lenses.names[:4]
    }
    found = opened.evaluate(
        f"""
        const wanted = {json.dumps(wanted)}, out = {{}};
        const list = document.getElementById("camera");
        for (const [name, pixels] of Object.entries(wanted)) {{
          list.value = name;
          list.dispatchEvent(new Event("change"));
          document.getElementById("clear").click();
          for (const [u, v] of pixels) {{
            document.getElementById("column").value = u;
            document.getElementById("row").value = v;
            document.getElementById("cast").click();
          }}
          out[name] = rays.drawn;
        }}
        return out;
        """
    )
    for camera in lenses[:4]:
        points = np.array(found[camera.name], float)  # six rays, start and end
        np.testing.assert_allclose(points[:, 0], np.tile(camera.position, (6, 1)), rtol=1e-12)
        drawn = points[:, 1] - points[:, 0]
        drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
        true = camera.rays(wanted[camera.name])[1]
        off = np.linalg.norm(np.cross(drawn, true), axis=1) * camera.camera_matrix[0, 0]
        assert off.max() < 0.05  # pixels


def test_a_click_on_the_picture_is_the_pixel_below_it(opened, lenses):
    browser = opened
    x, y = browser.evaluate(
        """
        const list = document.getElementById("camera");
        const picture = document.getElementById("picture");
        list.value = "bent";
        list.dispatchEvent(new Event("change"));
        picture.scrollIntoView({ block: "center" });
        await settled();
        const b = picture.getBoundingClientRect();
        return [b.left + picture.clientLeft + 0.25 * picture.clientWidth,
                b.top + picture.clientTop + 0.5 * picture.clientHeight];
        """
    )
    x, y = round(x), round(y)
    for kind in ("mousePressed", "mouseReleased"):
        browser.command(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1
        )
    found = browser.evaluate(
        """
        await settled();
        const line = document.getElementById("ray");
        const picture = document.getElementById("picture"), pen = picture.getContext("2d");
        const share = pen.getTransform();
        scrollTo(0, 0);
        const [u, v] = rays.marks.get("bent")[0];
        const at = share.transformPoint(new DOMPoint(u, v));
        return {
          pixel: [u, v],
          asked: [document.getElementById("column").value, document.getElementById("row").value],
          direction: JSON.parse(line.dataset.direction),
          text: line.textContent,
          mark: [...pen.getImageData(Math.round(at.x), Math.round(at.y), 1, 1).data],
        };
        """
    )
    assert found["pixel"] == pytest.approx([159.5, 239.5], abs=2)  # a screen's pixel holds two
    assert [float(value) for value in found["asked"]] == pytest.approx(found["pixel"], abs=0.06)
    true = lenses["bent"].rays([found["pixel"]])[1][0]
    np.testing.assert_allclose(found["direction"], true, atol=1e-4)
    assert found["text"].startswith("bent, pixel (1")
    assert "crosses the volume" in found["text"] or "misses the volume" in found["text"]
    assert found["mark"][0] > 150 > found["mark"][1]  # the cross, magenta on grey


def test_beside_the_lens_there_is_no_ray_and_the_page_says_so(opened, lenses):
    assert np.isnan(lenses["folded"].rays([[0.0, 0.0]])[1]).all()
    found = opened.evaluate(
        """
        const list = document.getElementById("camera"), out = [];
        list.value = "folded";
        list.dispatchEvent(new Event("change"));
        document.getElementById("clear").click();
        for (const [u, v] of [[0, 0], [300, 250]]) {
          document.getElementById("column").value = u;
          document.getElementById("row").value = v;
          document.getElementById("cast").click();
          out.push(document.getElementById("ray").textContent);
        }
        return [out, rays.drawn.length, stages[0].lines.length];
        """
    )
    assert "maps no direction" in found[0][0]
    assert "crosses the volume" in found[0][1]
    assert found[1:] == [1, 1]


def test_orbit_and_zoom_by_mouse_and_the_names_follow(opened):
    browser = opened
    state = f"""
        const stage = stages[0];
        {SHOWN}
        return [[stage.azimuth, stage.elevation, stage.distance], boxes, stage.box];
    """

    def mouse(kind, x, y, **options):
        browser.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, **options)

    eye, boxes, whole = browser.evaluate(state)
    mouse("mouseMoved", 300, 400)
    mouse("mousePressed", 300, 400, button="left", buttons=1, clickCount=1)
    for step in range(1, 9):
        mouse("mouseMoved", 300 + 15 * step, 400 + 5 * step, button="left", buttons=1)
    mouse("mouseReleased", 420, 440, button="left", clickCount=1)
    browser.evaluate("await settled();")
    turned_eye, turned_boxes, _ = browser.evaluate(state)
    assert abs(turned_eye[0] - eye[0]) > 0.5
    assert turned_eye[1] > eye[1] + 0.1  # what is dragged down shows more of its top
    assert turned_eye[2] == eye[2]
    assert turned_boxes != boxes
    mouse("mouseWheel", 340, 420, deltaX=0, deltaY=-300)
    browser.evaluate("await settled();")
    assert browser.evaluate(state)[0][2] < 0.95 * eye[2]
    press = 'document.querySelectorAll(".zooms button")[{}].click(); await settled();'
    close = np.array(browser.evaluate(press.format(1) + state)[2])
    assert np.ptp(close[:, 0]) < 0.3 * np.ptp(np.array(whole)[:, 0])
    assert (close[0] < GRID.lower - GRID.center).all()
    assert (close[1] > GRID.upper - GRID.center).all()
    assert browser.evaluate(press.format(0) + state)[2] == whole


def test_hostile_names_are_text_and_a_clicked_camera_is_chosen(opened):
    found = opened.evaluate(
        """
        const out = [...document.getElementById("camera").options].map((option) => option.value);
        const stage = stages[0], chosen = [], told = [];
        stage.zoom(0);
        for (const name of stage.layers.keys()) stage.choose(name, name === "cameras");
        await settled();
        for (const index of [0, 3]) {
          const part = stage.light.batches.find((one) => one.mesh.group === "cameras"
            && one.mesh.opacity < 1 && one.mesh.names.includes(out[index]));
          const before = part.mesh.counts.slice(0, part.mesh.names.indexOf(out[index]));
          const start = 3 * before.reduce((a, b) => a + b, 0);
          const at = stage.point([...part.positions.slice(start, start + 3)]);
          const bounds = stage.canvas.getBoundingClientRect();
          const event = { offsetX: at.x, offsetY: at.y, clientX: bounds.left + at.x,
            clientY: bounds.top + at.y, pointerId: 1, bubbles: true };
          const under = stage.under(event);
          told.push(under && under.name);
          for (const heard of stage.listeners) heard(under);
          chosen.push(document.getElementById("camera").value);
        }
        for (const name of stage.layers.keys())
          stage.choose(name, stage.data.layers.find((one) => one.name === name).visible);
        return { names: out, chosen, told, images: document.querySelectorAll("img").length,
                 rows: [...document.querySelectorAll(".tables tbody th")].map(
                   (cell) => cell.textContent) };
        """
    )
    assert found["names"] == ["pinhole", "bent", "wide", HOSTILE, "folded"]
    assert found["told"] == found["chosen"] == ["pinhole", HOSTILE]
    assert found["rows"] == found["names"]
    assert found["images"] == 1  # the still picture


def test_names_never_overlap_from_wherever_one_looks(open_page, tmp_path):
    count = 40
    rig = ring(count, distance=400.0, image_size=(64, 64), footprint=0.5, pitch_degrees=8.0)
    write_html(tmp_path / "r.html", rig_scene(rig, GRID), grid=GRID, views=camera_views(rig, GRID))
    found = open_page(tmp_path / "r.html").evaluate(
        f"""
        const out = [];
        for (const [azimuth, elevation] of [[0.5, 0.5], [0, 0.04], [0, 1.5], [-1.3, 0.4]]) {{
          Object.assign(stages[0], {{ azimuth, elevation }});
          stages[0].now();
          {SHOWN}
          out.push(boxes);
        }}
        document.querySelector('[data-layer="names"]').click();
        await settled();
        {SHOWN}
        out.push(boxes);
        return out;
        """
    )
    *seen, off = found
    assert off == []
    assert len(seen[0]) == count
    for boxes in seen:
        assert len(boxes) >= 0.5 * count
        for k, (_, left, top, right, bottom) in enumerate(boxes):
            for _, *other in boxes[:k]:
                apart = left >= other[2] or right <= other[0]
                assert apart or top >= other[3] or bottom <= other[1]
    assert [b[1:3] for b in seen[0]] != [b[1:3] for b in seen[1]]  # they followed the orbit


@pytest.mark.parametrize(("shape", "size"), [((8, 40, 8), (1400, 700)), ((40, 8, 8), (700, 1000))])
def test_the_whole_box_is_in_the_pane_at_first_and_after_a_zoom(open_page, tmp_path, shape, size):
    grid = VoxelGrid(shape, 1.0, (3.0, 0.0, -2.0))
    rig = ring(6, distance=400.0, image_size=(64, 64), footprint=0.5, center=grid.center)
    data = np.ones(shape, np.float32)
    write_html(tmp_path / "volume.html", Scene(), shown=Shown((Volume(data, grid),)))
    write_html(tmp_path / "rig.html", rig_scene(rig, grid), grid=grid)
    corners = np.stack(np.meshgrid(*zip(grid.lower, grid.upper, strict=True)), -1).reshape(-1, 3)
    seen = f"""
        await settled();
        const stage = stages[0], canvas = stage.canvas, origin = stage.data.origin;
        return [canvas.clientWidth, canvas.clientHeight, {corners.tolist()}.map(
          (corner) => stage.point(along(corner, origin, -1)))];
    """
    press = 'document.querySelectorAll(".zooms button")[1].click();'
    for name, before in (("volume", ""), ("rig", press)):
        opened = open_page(tmp_path / f"{name}.html", size)
        width, height, points = opened.evaluate(before + seen)
        assert all(0 < p["x"] < width and 0 < p["y"] < height for p in points)
        across = np.ptp([p["x"] for p in points]) / width
        along = np.ptp([p["y"] for p in points]) / height
        assert max(across, along) > 0.3
