"""A review: edits, undo and redo, two pages, what survives a kill, and what is signed."""

import gc
import json
import socket
import subprocess
import weakref
from dataclasses import replace
from urllib.parse import urlsplit

import httpx2
import numpy as np
import pandas as pd
import pytest
from reviewing import copied, review, served, token_in, until

from ema.core.edits import ChannelName, Edit, EditKind
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.edits_file import read_edits
from pipelines.results.store import load
from pipelines.review.bench import Bench


def arrays(answer):
    """Header and arrays of an answer."""
    content = answer.content
    end = 4 + int.from_bytes(content[:4], "little")
    head, at, found = json.loads(content[4:end]), end, {}
    for each in head["arrays"]:
        size = int(np.prod(each["shape"]))
        found[each["name"]] = np.frombuffer(content, "<f4", size, at).reshape(each["shape"])
        at += 4 * size
    assert at == len(content)
    assert end % 4 == 0
    return head, found


def aside(mode, reason=""):
    return {"kind": "set_aside", "pole": mode["pole"], "reason": reason}


def test_set_aside_undo_and_redo(page):
    before = page.settled()
    mode = before["modes"][1]
    answer = page.edit(**aside(mode, "no partner")).json()
    assert (answer["revision"], answer["cursor"]) == (1, 1)
    after = page.settled()
    assert [each["chosen"] for each in after["modes"]] == [
        *("automatic", "set aside", "automatic", "automatic")
    ]
    assert after["edits"][0]["reason"] == "no partner"
    assert after["edits"][0]["text"].startswith(
        f"Set aside {mode['name']}, {mode['frequency_hz']:.2f} Hz"
    )
    undone = page.post("cursor", revision=1, cursor=0).json()
    assert undone["stage"] == "final"  # cached
    assert undone["modes"] == before["modes"]
    redone = page.post("cursor", revision=2, cursor=1).json()
    assert redone["modes"] == after["modes"]


def test_an_edit_behind_undone_ones_replaces_them(page):
    first, second = page.settled()["modes"][:2]
    page.edit(**aside(first))
    page.settled()
    page.post("cursor", revision=1, cursor=0)
    page.edit(**aside(second))
    state = page.settled()
    assert [each["mode"] for each in state["edits"]] == [second["name"]]


def test_two_pages_cannot_overwrite_each_other(page):
    first, second = page.settled()["modes"][:2]
    assert page.post("edit", revision=0, edit=aside(first)).status_code == 200
    stale = page.post("edit", revision=0, edit=aside(second))
    assert stale.status_code == 409
    assert stale.json()["state"]["revision"] == 1
    assert page.post("cursor", revision=0, cursor=0).status_code == 409
    assert page.post("try", revision=0, edit=aside(second)).status_code == 409
    assert len(page.state()["edits"]) == 1


def test_an_edit_that_names_no_mode_is_taken_back_and_said(page):
    page.settled()
    page.edit(kind="set_aside", pole={"frequency_hz": 111.0})
    state = until(page.state, lambda state: state["error"] is not None)
    assert "111" in state["error"]["found"]
    assert state["edits"] == []
    assert page.settled()["stage"] == "final"


def test_channels_are_left_out_and_come_back(page):
    page.settled()
    page.edit(kind="channel_out", channel="A03", run="config_2.uff")
    state = page.settled()
    out = [each for each in state["channels"] if not each["used"]]
    assert [(each["channel"], each["run"]) for each in out] == [("A03", "config_2.uff")]
    assert out[0]["by_hand"]
    head, found = arrays(page.get("fit", row=out[0]["row"]))
    assert head["frac"] is None
    assert found["real"].size == 0
    assert arrays(page.get("frf", row=out[0]["row"]))[1]["real"].size
    page.edit(kind="flip", channel="A04")
    assert {each["sign"] for each in page.settled()["channels"]} == {1, -1}
    page.post("cursor", revision=2, cursor=0)
    assert all(each["used"] and each["sign"] == 1 for each in page.settled()["channels"])


def test_what_is_set_aside_behind_a_channel_is_named_so(page):
    """Leaving a channel out moves the poles: a later edit names them where they are then."""
    page.settled()
    page.edit(kind="channel_out", channel="A03", run="config_2.uff")
    page.edit(**aside(page.listed()[1]))
    assert [each["chosen"] for each in page.settled()["modes"]].count("set aside") == 1


def test_band_and_order_change_what_is_found(page):
    assert len(page.listed()) == 4
    page.edit(kind="settings", settings={"band_hz": [60.0, 130.0], "max_order": 40})
    assert len(page.listed()) == 3
    head, found = arrays(page.get("diagram"))
    assert head["band_hz"] == [60.0, 130.0]
    assert found["model_order"].max() <= 40


def test_trying_changes_nothing(page):
    state = page.settled()
    cost = page.post("try", revision=0, edit=aside(state["modes"][2])).json()
    assert cost["change"] > 0
    assert cost["chi2_after"] > cost["chi2_before"]
    assert len(cost["shifts"]) == 3
    assert page.state() == state


def test_curves_and_evidence_of_every_mode(page):
    state = page.settled()
    _, frf = arrays(page.get("frf", row=3))
    head, fit = arrays(page.get("fit", row=3))
    inside = np.isin(frf["frequency_hz"], fit["frequency_hz"])
    measured = (frf["real"] + 1j * frf["imag"])[inside]
    fitted = fit["real"] + 1j * fit["imag"]
    assert head["frac"] > 0.99
    assert np.abs(fitted - measured).max() < 0.2 * np.abs(measured).max()
    assert np.median(fit["residual_sigma"]) < 3
    head, shapes = arrays(page.get("shapes"))
    assert head["keys"] == [mode["key"] for mode in state["modes"]]
    assert np.allclose(np.diag(shapes["automac"]), 1)
    assert np.allclose(shapes["ring"], shapes["real"], atol=0.1)
    assert state["has_force"]
    run = state["channels"][0]["run"]
    about, force = arrays(page.get("force", run=run))
    assert (about["run"], len(force["psd"])) == (run, len(force["frequency_hz"]))
    assert np.sum(force["psd"]) * np.diff(force["frequency_hz"])[0] > 0
    _, orders = arrays(page.get("orders"))
    for mode in state["modes"]:  # each order is largest at its own mode
        line = np.argmin(np.abs(orders["frequency_hz"] - mode["frequency_hz"]))
        assert np.argmax(orders["level"][:, line]) == mode["order"]
        why = page.get("why", key=mode["key"]).json()
        assert why["lines"][0]["label"] == "Seen at"
    assert page.get("why", key="no").status_code == 404
    assert page.get("frf", row=72).status_code == 404


def test_nothing_is_lost_when_the_server_is_killed(folder):
    with served(folder) as (process, address, file):
        assert (file.stat().st_mode & 0o777, process.poll()) == (0o600, None)
        token, name = token_in(file), address.rsplit("/", 1)[1]
        origin = address.removesuffix(f"/r/{name}")
        headers = {"Origin": origin, "X-Ringmodal-Token": token}
        place = f"{origin}/api/r/{name}"
        asked = ["ps", "-o", "args=", "-p", str(process.pid)]
        arguments = subprocess.run(asked, check=True, capture_output=True, text=True).stdout
        assert token not in arguments
        with httpx2.Client(headers=headers, timeout=60) as client:
            edit = aside(client.get(f"{place}/state").json()["modes"][0], "kept over a kill")
            answer = client.post(f"{place}/edit", json={"revision": 0, "edit": edit})
            assert answer.status_code == 200
            fitted = until(
                lambda: client.get(f"{place}/state").json(), lambda told: told["stage"] == "final"
            )["misfits"]
            assert fitted[1] is not None
        process.kill()
        process.wait()
        said = process.stdout.read() + process.stderr.read()
        assert token not in said + address
    with review(folder) as page:
        assert page.state()["misfits"] == fitted
        state = page.settled()
        assert [each["reason"] for each in state["edits"]] == ["kept over a kill"]
        assert state["modes"][0]["chosen"] == "set aside"


def test_a_line_cut_by_a_kill_is_dropped(folder):
    with review(folder) as page:
        page.edit(**aside(page.settled()["modes"][0]))
    draft = folder.parent / ".ringmodal-review" / "result.jsonl"
    whole = draft.read_bytes()
    for cut in (whole + whole.splitlines()[-1][:-7], whole + b"{"):
        draft.write_bytes(cut)
        with review(folder) as page:
            assert len(page.state()["edits"]) == 1
        assert draft.read_bytes() == whole


def test_a_draft_of_an_earlier_result_is_set_aside(folder):
    with review(folder) as page:
        page.edit(**aside(page.settled()["modes"][0]))
    save(replace(load(folder), name="another"), folder, report=False, force=True)
    with review(folder) as page:
        assert page.state()["edits"] == []
    assert len(list((folder.parent / ".ringmodal-review").glob("result.kept-*"))) == 1


def test_one_server_reviews_a_result(folder, page):
    page.state()
    with review(folder) as other:
        answer = other.get("state")
        assert answer.status_code == 400
        assert "under review already" in answer.json()["error"]["found"]


def test_drafts_go_elsewhere_where_nothing_can_be_written(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (folder.parent / ".ringmodal-review").write_text("in the way")
    with review(folder) as page:
        page.edit(**aside(page.settled()["modes"][0]))
    with review(folder) as page:
        assert len(page.state()["edits"]) == 1
    assert list((tmp_path / "state" / "ringmodal" / "review").glob("*.jsonl"))


def test_many_edits_at_once_end_in_the_last_ones_numbers(page):
    modes = page.settled()["modes"]
    for k in range(11):
        page.edit(kind="flip", channel="A03") if k % 2 else page.edit(**aside(modes[0]))
    state = page.settled()
    assert state["revision"] == 11
    assert state["stage"] == "final"
    channels = {each["sign"] for each in state["channels"] if each["channel"] == "A03"}
    assert channels == {-1}


def test_what_an_edit_replaced_is_freed_at_once(folder):
    """A cycle would hold its FRFs until the garbage collector comes: hundreds of megabytes."""

    class Asleep:
        def wake(self, work):
            """Steps are done below."""

    bench = Bench("tyre", folder, Asleep(), lambda state: None)
    gc.collect()
    gc.disable()
    try:
        fitted = []
        for channel in ("A03", "A04", "A05", "A06"):
            flip = Edit(EditKind.FLIP, channel=ChannelName(channel))
            bench.applied(bench.session.revision, flip)
            while bench.step(lambda: False):
                bench.state()
            fitted.append(weakref.ref(bench.sight().frf))
        assert fitted[0]() is None
        assert fitted[-1]() is not None
    finally:
        gc.enable()
        bench.close()


def comparable(folder):
    """Everything of a result but when and where it was made."""
    files = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".parquet":
            files[path.name] = pd.read_parquet(path).to_json(double_precision=15)
        elif path.suffix in (".csv", ".uff") or path.name == "identification.json":
            files[path.name] = path.read_bytes()
    return files


def test_what_is_signed_is_what_the_record_gives(page, folder, short_campaign, tmp_path):
    modes = page.settled()["modes"]
    page.edit(**aside(modes[1], "spurious"))
    page.edit(kind="channel_out", channel="A03", run="config_2.uff", reason="loose")
    state = page.settled()
    off = page.get("signoff").json()
    assert off["ready"]
    assert off["folder"] == "result_reviewed"
    signed = {"by": "A. Keller", "note": "see photo 12", "folder": off["folder"]}
    answer = page.post("sign", revision=state["revision"], **signed)
    assert answer.status_code == 200
    target = folder.with_name("result_reviewed")
    assert page.state()["edits"] == []  # the draft is done with
    assert page.state()["revision"] > state["revision"]  # or pages would take it for an old one
    record = read_edits(target / "edits.toml")
    assert (record.signed["by"], record.signed["note"]) == ("A. Keller", "see photo 12")
    assert (target / "report.html").is_file()
    again = process(short_campaign, edits=record)
    save(again, tmp_path / "again", report=False)
    assert comparable(tmp_path / "again") == comparable(target)
    shown = [mode["frequency_hz"] for mode in state["modes"] if mode["listed"]]
    assert shown == load(target).modal_model.frequencies_hz.tolist()


@pytest.mark.parametrize(
    ("by", "name"),
    [
        *(("", "new"), ("A", "../new"), ("A", ""), ("A", "."), ("A", "a/b"), ("A", ".hidden")),
        *(("A", "result"), ("A" * 300, "new"), ("A", "a\\b"), ("A", "a\x00b"), ("A", "..")),
    ],
)
def test_what_cannot_be_signed(page, folder, by, name):
    page.settled()
    before = sorted(path.name for path in folder.parent.iterdir())
    answer = page.post("sign", revision=0, by=by, note="", folder=name)
    assert answer.status_code == 400
    assert sorted(path.name for path in folder.parent.iterdir()) == before


def test_each_force_shows_its_frfs_with_the_fit_and_is_decided_on(reviewed_of_two, tmp_path):
    with review(copied(reviewed_of_two, tmp_path)) as page:
        state = page.settled()
        assert state["forces"] == ["0°", "22.5°"]
        first, second = ([c for c in state["channels"] if c["force"] == k] for k in (1, 2))
        assert [each["row"] for each in first + second] == list(range(144))
        for each in (first[7], second[7]):
            _, measured = arrays(page.get("frf", row=each["row"]))
            head, fitted = arrays(page.get("fit", row=each["row"]))
            lines = np.isin(measured["frequency_hz"], fitted["frequency_hz"])
            away = np.linalg.norm(measured["real"][lines] - fitted["real"])
            assert away < 0.3 * np.linalg.norm(fitted["real"])  # leakage of 4 s is in it
            assert head["frac"] == pytest.approx(each["frac"])
        indicator = [arrays(page.get("diagram", force=k))[1]["nmif"] for k in (1, 2)]
        assert not np.array_equal(*indicator)
        assert page.get("diagram", force=3).status_code == 404
        assert page.get("frf", row=144).status_code == 404
        why = page.get("why", key=state["modes"][0]["key"]).json()["lines"]
        assert len([line for line in why if line["label"].startswith("Force ")]) == 2
        out = {name: second[7][name] for name in ("channel", "run")}
        page.edit(kind="channel_out", reference=2, **out)
        after = page.settled()
        assert [c["row"] for c in after["channels"] if not c["used"]] == [second[7]["row"]]
        page.edit(**aside(after["modes"][2], "no partner"))
        state = page.settled()
        signed = page.post(
            "sign", revision=state["revision"], by="A", note="", folder="signed"
        ).json()
        result = load(tmp_path / signed["folder"])
        assert [edit.kind for edit in result.edits] == ["channel_out", "set_aside"]
        shown = [mode["frequency_hz"] for mode in state["modes"] if mode["listed"]]
        assert [mode.frequency_hz for mode in result.modal_model.modes] == shown
        assert {each.reference for each in result.references} == {1, 2}


def test_a_preview_cannot_be_signed(page, folder):
    page.settled()
    page.edit(kind="channel_out", channel="A03")
    answer = page.post("sign", revision=1, by="A", note="", folder="new")
    assert answer.status_code == 409
    assert not (folder.parent / "new").exists()


def test_results_of_earlier_versions_are_shown_and_not_edited(folder):
    content = json.loads((folder / "identification.json").read_text())
    content["setup"] = None
    (folder / "identification.json").write_text(json.dumps(content))
    result = load(folder, accept_changes=True)
    save(result, folder.with_name("old"), report=False)
    with review(folder.with_name("old")) as page:
        state = page.settled()
        assert state["stage"] == "failed"
        assert "Process the recordings again" in state["error"]["remedy"]
        assert len(state["modes"]) == 4


def test_the_command_without_its_libraries(ringmodal, folder, monkeypatch):
    monkeypatch.setattr("pipelines.cli.review.find_spec", lambda name: None)
    code, _, error = ringmodal("review", folder)
    assert code == 2
    assert "pip install" in error and "starlette" in error


def test_the_command_names_what_is_wrong(ringmodal, tmp_path):
    code, _, error = ringmodal("review", tmp_path / "none")
    assert code == 2
    assert "no folder" in error


def test_ctrl_c_ends_the_server(folder):
    """Until then it listens on one address of this machine alone."""
    with served(folder) as (process, address, file):
        host, port = urlsplit(address).hostname, urlsplit(address).port
        assert host == "127.0.0.1"
        with pytest.raises(OSError):  # where all addresses are listened on, this is one of them
            socket.create_connection(("127.0.0.2", port), timeout=1).close()
        assert file.is_file()
    assert process.returncode == 0
    assert not file.exists()
    with review(folder) as page:  # its lock is free
        assert page.state()["edits"] == []
