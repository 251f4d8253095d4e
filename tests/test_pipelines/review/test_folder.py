"""The landing page of a folder, processing from there, and several results side by side."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from reviewing import Page, until

from ema.core.campaign import Tyre
from pipelines.batch.run import run_batch
from pipelines.library.library import TyreLibrary
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.results.store import load
from pipelines.review.answers import Office
from pipelines.review.folder import compared, is_at_rig, landing, search


@pytest.fixture
def lab(tmp_path, reviewed_once, short_campaign):
    """A folder with a result, a campaign, recordings alone, and things that are neither."""
    shutil.copytree(reviewed_once, tmp_path / "a" / "result")
    shutil.copytree(short_campaign, tmp_path / "fresh")
    shutil.copytree(short_campaign, tmp_path / "bare")
    (tmp_path / "bare" / "campaign.toml").unlink()
    shutil.copytree(short_campaign, tmp_path / ".hidden")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "readme.txt").write_text("nothing")
    return tmp_path


@pytest.fixture
def home(lab):
    desk = Office(lab)
    yield Page(desk, "")
    desk.close()


def test_results_and_campaigns_are_found(home, lab):
    told = home.client.get("/api/home").json()
    (result,) = told["results"]
    assert (result["name"], result["modes"], result["reviewed"]) == ("a/result", 4, "")
    assert [(each["name"], each["manifest"]) for each in told["campaigns"]] == [
        *(("bare", "none"), ("fresh", "ready"))
    ]
    assert told["campaigns"][0]["files"].startswith("6 UFF, ")
    for row in (*told["results"], *told["campaigns"]):
        assert str(lab) not in row["id"]
    assert home.client.get(f"/api/r/{result['id']}/state").status_code == 200


def test_the_folder_of_one_campaign_is_watched(lab):
    """With its manifest or without, before its first recording too; not with a result in it."""
    (lab / "empty").mkdir()
    watched = {each.name for each in lab.iterdir() if is_at_rig(each)}
    assert watched == {"fresh", "bare", "empty", "notes", ".hidden"}
    assert not is_at_rig(lab)


def test_a_link_to_elsewhere_is_not_followed(home, lab, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside")
    shutil.move(lab / "a" / "result", outside / "result")
    (lab / "linked").symlink_to(outside)
    assert home.client.get("/api/home").json()["results"] == []


def test_what_needs_a_look_comes_first(lab):
    result = load(lab / "a" / "result")
    doubtful = replace(result, modal_model=replace(result.modal_model, misfit=9.0))
    save(doubtful, lab / "z" / "result", report=False)
    signed = {**result.provenance, "signed": {"by": "A. Keller", "at": "2026-11-28T10:00:00Z"}}
    save(replace(doubtful, provenance=signed), lab / "s" / "result", report=False)
    (lab / "b").mkdir()
    (lab / "b" / "provenance.json").write_text("{}")
    rows = {row["name"]: row for row in landing(lab, str, {})["results"]}
    assert list(rows) == sorted(
        rows, key=lambda name: (not rows[name]["needs_look"], -len(rows[name]["doubts"]), name)
    )
    assert [rows[name]["needs_look"] for name in ("z/result", "b", "s/result")] == [1, 1, 0]
    assert rows["z/result"]["doubts"][-1] == "χ² 9"
    assert rows["b"]["doubts"] == ["cannot be read"]
    assert rows["s/result"]["reviewed"] == "signed A. Keller 2026-11-28"


def test_a_campaign_is_processed_from_there(home, lab):
    def row():
        told = home.client.get("/api/home").json()
        return next(each for each in told["campaigns"] if each["name"] == "fresh")

    name = row()["id"]
    answer = home.client.post("/api/home/process", json={"id": name})
    assert answer.json()["job"]["state"] == "running"
    again = home.client.post("/api/home/process", json={"id": name})
    assert again.status_code == 400
    ended = until(lambda: row()["job"], lambda job: job["state"] != "running")
    assert ended["state"] == "done"
    assert (lab / "fresh" / "result" / "report.html").is_file()
    results = [each["name"] for each in home.client.get("/api/home").json()["results"]]
    assert "fresh/result" in results
    assert home.client.post("/api/home/process", json={"id": name}).status_code == 400
    assert home.client.post("/api/home/process", json={"id": "../fresh"}).status_code == 404


def test_a_batch_and_a_library_are_shown(lab, short_result):
    run_batch(lab / "fresh", lab / "night", Options(tune=False), jobs=1)
    save(short_result, lab / "set", report=False)
    TyreLibrary(lab / "tyres").add(lab / "set", author="A. Keller")
    told = landing(lab, str, {})
    assert told["batch"] == {
        **{"name": "night", "done": 1, "total": 1, "running": False},
        **{"failed": 0, "failures": [], "per_minute": None},
    }
    (lab / "night" / "summary.html").unlink()  # as long as it runs
    batch = landing(lab, str, {})["batch"]
    assert (batch["running"], batch["done"], batch["total"]) == (True, 1, 2)
    ((library,), (tyre,)) = told["libraries"], told["libraries"][0]["sets"]
    assert library["name"] == "tyres"
    assert (tyre["versions"], tyre["approved"]) == (1, "")
    assert tyre["verdict"]
    assert search(lab).libraries == (lab / "tyres",)


def with_pressure(result, bar, factor):
    """The result at another pressure, all frequencies higher by a factor."""
    modes = tuple(replace(mode, pole=mode.pole * factor) for mode in result.modal_model.modes)
    tyre = Tyre("225/55R17", inflation_pressure_pa=bar * 1e5, details={"load_n": "4000"})
    tyre.details["date"] = f"2026-11-2{bar:.0f}T09:00"
    return replace(result, tyre=tyre, modal_model=replace(result.modal_model, modes=modes))


def test_modes_are_followed_over_pressure(reviewed_once):
    first = load(reviewed_once)
    second, third = with_pressure(first, 2.4, 1.08), with_pressure(first, 2.6, 1.16)
    fewer = replace(third.modal_model, modes=third.modal_model.modes[1:])
    told = compared(
        [with_pressure(first, 2.2, 1.0), second, replace(third, modal_model=fewer)], "abc"
    )
    assert [axis["name"] for axis in told["axes"]] == ["pressure", "load", "time"]
    assert (told["axes"][2]["unit"], told["axes"][2]["values"]) == ("h", [0.0, 0.0, 24.0])
    assert told["axes"][0]["values"] == pytest.approx([2.2, 2.4, 2.6])
    for track, mode in zip(told["tracks"], first.modal_model.modes, strict=True):
        assert track["order"] == mode.order
        shown = [None if each is None else each["frequency_hz"] for each in track["points"]]
        assert shown[:2] == pytest.approx([mode.frequency_hz, 1.08 * mode.frequency_hz])
    assert told["tracks"][0]["points"][2] is None


def test_modes_are_matched_as_by_compare(reviewed_once):
    """A pair beside a single mode is its mean; modes without order are matched by their shapes."""
    first = load(reviewed_once)
    model = first.modal_model
    pair = replace(model.modes[0], member="a"), replace(model.modes[0], member="b")
    split = replace(model, modes=(*pair, *model.modes[1:]), covariance=np.zeros((10, 10)))
    told = compared([first, replace(first, modal_model=split)], "ab")
    assert [track["points"][1]["is_mean"] for track in told["tracks"]] == [True] + 3 * [False]
    # Two modes change places: by frequency alone they would be mistaken for each other.
    one, two = (replace(mode, order=None) for mode in model.modes[1:3])
    swapped = replace(one, pole=two.pole), replace(two, pole=one.pole)
    told = compared(
        [replace(first, modal_model=replace(model, modes=m)) for m in ((one, two), swapped)], "ab"
    )
    for track in told["tracks"]:
        assert track["points"][0]["purity"] == track["points"][1]["purity"]


def test_comparisons_are_of_two_or_more_results(home, lab):
    shutil.copytree(lab / "a" / "result", lab / "b" / "result")
    ids = [row["id"] for row in home.client.get("/api/home").json()["results"]]

    def asked(place, names, **query):
        return home.client.get(place, params={"ids": ",".join(names), **query})

    assert asked("/api/compare", ids).status_code == 200
    assert asked("/api/compare", ids[:1]).status_code == 400
    assert asked("/api/compare", [ids[0], "nope"]).status_code == 404
    answer = asked("/api/compare/frf", ids, position_deg=31)
    head = json.loads(answer.content[4 : 4 + int.from_bytes(answer.content[:4], "little")])
    assert [row["position_deg"] for row in head["rows"]] == [30.0, 30.0]
    assert asked("/api/compare/frf", ids, position_deg="x").status_code == 400
