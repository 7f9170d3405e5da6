"""``civil-rgbd new-bridge``: say what a contributed bridge is."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from civil_rgbd.cli.places import dataset_option, refuse_remote

if TYPE_CHECKING:
    from civil_rgbd.contribution.answers import Answers
    from civil_rgbd.contribution.questions import Question


@click.command("new-bridge")
@click.argument("bridge_id", metavar="ID")
@dataset_option("The dataset folder that the bridge is in, or will be built in.")
@click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="TOML with the answers: nothing is asked, and what it leaves out stays as it is.",
)
def command(bridge_id: str, *, dataset: Path, source: Path | None) -> None:
    """Say what bridge ID is: place, structure, owner, consent, licence, sensors, privacy.

    Without --from each question is asked; an empty answer keeps what is known already. The answers
    go into the manifest of the bridge when it is built, and in any case to FOLDER/ID.toml, which
    a build takes with --bridge-info.
    """
    from civil_rgbd.contribution.scaffold import (
        known_answers,
        laid_over,
        open_submission,
        write_submission,
    )

    refuse_remote(dataset, option="--out")
    submission = open_submission(dataset, bridge_id)
    answers = known_answers(submission)
    answers = laid_over(answers, source, bridge_id) if source else _ask_all(answers)
    for path in write_submission(submission, answers, given=source):
        print(f"wrote {path}")
    _say_what_is_next(answers, dataset, bridge_id, built=submission.is_built, toml=submission.toml)


def _ask_all(known: Answers) -> Answers:
    from civil_rgbd.contribution.questions import QUESTIONS

    click.echo("An empty answer keeps what is in brackets; a single - deletes it.", err=True)
    answers = dict(known)
    for question in QUESTIONS:
        value = _ask(question, answers.get(question.key))
        if value is None:
            answers.pop(question.key, None)
        else:
            answers[question.key] = value
    return answers


def _ask(question: Question, known: object) -> object:
    from civil_rgbd.errors import UsageError

    if question.choices:
        click.echo(f"\n  one of: {', '.join(question.choices)}", err=True)
    words = question.words + ("" if question.needed else " (may be left out)")
    shown = f" [{_shown(known)}]" if known is not None else ""
    while True:
        try:
            typed = click.prompt(words + shown, default="", show_default=False, err=True)
        except click.Abort as error:
            if sys.stdin.isatty():
                raise
            raise UsageError(
                f"the answers end before the question {question.words!r}; nothing is written",
                where="standard input",
                fix="answer all questions, or give them in a file: --from answers.toml",
            ) from error
        if not typed.strip():
            return known
        if typed.strip() == "-":
            return None
        try:
            return question.parse(typed)
        except ValueError as error:
            click.echo(f"  {error}", err=True)


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{number:g}" for number in value.values())
    return ", ".join(value) if isinstance(value, list) else str(value)


def _say_what_is_next(
    answers: Answers, dataset: Path, bridge_id: str, *, built: bool, toml: Path
) -> None:
    from civil_rgbd.contribution.questions import QUESTIONS

    missing = [question.key for question in QUESTIONS if question.needed]
    missing = [key for key in missing if key not in answers]
    if missing:
        print(f"still to be said for a contribution: {', '.join(missing)}")
    if built:
        print(f"next: civil-rgbd validate {dataset} --profile contribution")
    else:
        print(
            f"next: civil-rgbd build --bridge {bridge_id} --out {dataset} --bridge-info {toml} SCAN"
        )
