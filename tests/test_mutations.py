"""The list of mutations stays true to the code, and a sample of it is tried."""

from __future__ import annotations

import pytest

from .mutations import MUTATIONS, ROOT, Copy, Mutation

SAMPLE = MUTATIONS[::14]


def test_mutations_have_names_of_their_own() -> None:
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS) >= 30


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_every_mutation_still_finds_its_text(mutation: Mutation) -> None:
    text = (ROOT / "civil_rgbd" / mutation.file).read_text("utf-8")

    assert text.count(mutation.old) == 1, "the code has changed: write the mutation anew"
    compile(text.replace(mutation.old, mutation.new), mutation.file, "exec")


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_every_mutation_is_in_the_table_of_the_proof(mutation: Mutation) -> None:
    table = (ROOT / "docs" / "geometry-proof.md").read_text("utf-8")

    assert f"| {mutation.name} |" in table, "run tests/mutations.py and renew the table"
    assert "**nothing**" not in table


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    made = Copy.into(tmp_path_factory.mktemp("copy"))
    assert made.caught_by(None) is None, "the tests fail as it is"
    return made


@pytest.mark.slow
@pytest.mark.parametrize("mutation", SAMPLE, ids=lambda mutation: mutation.name)
def test_a_mutation_fails_a_test(mutation: Mutation, copy: Copy) -> None:
    assert copy.caught_by(mutation) is not None
