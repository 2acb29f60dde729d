from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

from gcs.services.report_page import report_page
from gcs.storage.plan_files import plan_report


class Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text, self.attributes = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data):
        self.text.append(data)


def read(plan, structure):
    source = report_page(plan, structure, plan_report(plan, mission_items=9))
    page = Page()
    page.feed(source)
    return source, page


def test_the_page_is_complete_in_one_file(small_plan, small_structure):
    source, page = read(small_plan, small_structure)
    assert not {"script", "link", "img", "iframe", "object"} & set(page.tags)
    assert not [value for name, value in page.attributes if name in {"src", "href", "style"}]
    assert "http" not in source
    svg = [value for name, value in page.attributes if name == "width" and float(value) > 100]
    assert len(svg) == 4 + 3  # scene and speed, and what is not seen of the surface


def test_names_are_text(small_plan, small_structure):
    source, page = read(small_plan, small_structure)
    assert "box <1>" in page.text
    assert "<1>" not in source


def test_the_figures_and_the_clearance_budget_are_shown(small_plan, small_structure):
    _, page = read(small_plan, small_structure)
    text = " ".join(page.text)
    for expected in ("smallest hull clearance 3.5 m", "mission items 9", "asked between hull and surface 1.90 m"):
        assert expected in text
    assert "A, west" in text


def test_the_pictures_show_the_curve_inside_their_frame(small_plan, small_structure):
    source, _ = read(small_plan, small_structure)
    above = ElementTree.fromstring(source[source.index("<svg") : source.index("</svg>") + 6])
    curve = next(e for e in above if e.get("class") == "t")
    points = [tuple(map(float, pair.split(","))) for pair in curve.get("points").split()]
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    assert 0 <= min(xs) < max(xs) <= float(above.get("width"))
    # From home at the far left to (8, 0): level in this view, 8 of 30 m wide.
    assert max(ys) - min(ys) < 0.2
    assert abs((max(xs) - min(xs)) / (480 - 56) - 8 / 30) < 0.01


def test_the_camera_is_named(small_plan, small_structure):
    camera = small_plan.scenario.camera.model_copy(update={"model": "P1 <35 mm>"})
    scenario = small_plan.scenario.model_copy(update={"camera": camera})
    source, page = read(replace(small_plan, scenario=scenario), small_structure)
    assert "Camera P1 <35 mm>, 13.2 x 8.8 mm" in " ".join(page.text)
    assert "<35" not in source
