"""A session as a value, and its draft: undo takes an edit back, and a draft gives it again."""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.edits import ChannelName, Edit, EditKind, PoleName
from ema.core.errors import InputError
from pipelines.review.session import Session, key, n_drafted, opened

TEXTS = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=20)
FREQUENCIES = st.floats(1.0, 1000.0)
EDITS = st.one_of(
    st.builds(Edit, st.just(EditKind.SET_ASIDE), st.builds(PoleName, FREQUENCIES), reason=TEXTS),
    st.builds(
        Edit,
        st.just(EditKind.FLIP),
        channel=st.builds(ChannelName, TEXTS.filter(bool), st.none() | TEXTS.filter(bool)),
        by=TEXTS,
    ),
    st.builds(Edit, st.just(EditKind.NOTE), reason=TEXTS),
    st.builds(
        Edit, st.just(EditKind.SETTINGS), settings=st.fixed_dictionaries({"max_order": st.just(40)})
    ),
)
SESSIONS = st.lists(EDITS, max_size=4).map(lambda edits: Session(tuple(edits), len(edits)))


@given(SESSIONS, EDITS)
def test_undo_takes_an_edit_back(session, edit):
    applied = session.applied(edit)
    undone = applied.moved(session.cursor)
    assert undone.edits == session.edits
    assert undone.moved(applied.cursor).edits == applied.edits
    assert undone.revision > applied.revision > session.revision
    assert applied.without_last().edits == session.edits


@given(SESSIONS, st.integers(-2, 6))
def test_there_is_nothing_beyond_the_history(session, cursor):
    if 0 <= cursor <= len(session.history):
        assert len(session.moved(cursor).edits) == cursor
    else:
        with pytest.raises(InputError):
            session.moved(cursor)


@given(EDITS, TEXTS)
def test_a_reason_changes_no_number(edit, reason):
    session = Session().applied(edit)
    explained = session.explained(0, reason)
    assert explained.edits[0].reason == reason
    assert key(explained.edits) == key(session.edits)


@given(SESSIONS)
def test_a_note_changes_no_number(session):
    assert key(session.applied(Edit(EditKind.NOTE, reason="warm")).edits) == key(session.edits)


def test_the_sign_of_an_edit_matters():
    flipped = (Edit(EditKind.FLIP, channel=ChannelName("A03")),)
    assert key(flipped) != key(())
    assert key(flipped) != key((Edit(EditKind.FLIP, channel=ChannelName("A03", "config_1.uff")),))


STEPS = st.lists(st.tuples(st.sampled_from(["edit", "undo", "redo", "reason", "drop"]), EDITS))


def stepped(session, step, edit):
    """The session after a step, where it can be done."""
    if step == "edit" or not session.history:
        return session.applied(edit)
    if step == "reason":
        return session.explained(len(session.history) - 1, edit.reason)
    if step == "drop":
        return session.without_last() if session.cursor else session
    return session.moved(
        min(max(session.cursor + (1 if step == "redo" else -1), 0), len(session.history))
    )


@given(steps=STEPS)
def test_a_draft_gives_the_session_again(steps, reviewed_once):
    with TemporaryDirectory() as place:
        result = Path(place) / "result"
        result.mkdir()
        shutil.copy(reviewed_once / "provenance.json", result)
        draft = opened(result)
        for step, edit in steps:
            draft.record(stepped(draft.session, step, edit))
        draft.close()
        again = opened(result)
        assert again.session == draft.session
        assert n_drafted(result) == draft.session.cursor
        again.discard()
        assert n_drafted(result) == 0
