"""gmwm explain: what a message means and what to do."""

from __future__ import annotations

from typing import Annotated

import typer

from gmwm.base.remarks import Dialect, codes_text, explanation, messages
from gmwm.cli.command import command
from gmwm.cli.output import Outcome

EXAMPLES = ("gmwm explain warm-up", "gmwm explain")


@command
def explain(
    code: Annotated[
        str | None,
        typer.Argument(
            help="Code of a message, as the terminal shows it in brackets. Default: list all.",
            autocompletion=lambda incomplete: [code for code in messages() if code.startswith(incomplete)],
        ),
    ] = None,
) -> Outcome:
    """Explain a message: what it means for the results, and what to do.

    Every message has a code, which stands in brackets after the text. Several situations can have one code, if the same
    advice applies to them."""
    if code is None:
        return Outcome(command="explain", document={"codes": list(messages())}, text=codes_text())
    text = explanation(code, Dialect.SHELL)
    return Outcome(command="explain", document={"code": code.strip("[]"), "explanation": text}, text=text)
