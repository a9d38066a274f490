"""The tab "Model": the terms of the model of an axis, the fit, its tests, and a comparison with other models."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from dash import ALL, Dash, Input, Output, State, html, no_update

from gmwm.applications.app.figures import axis_at, fit_figure, movable, residual_figure
from gmwm.applications.app.page import widgets
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import SILENT_S, Desk, Workspace
from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.text import gap_text, p_text, round_fixed
from gmwm.base.units import sensor_of
from gmwm.choosing.selection.search import ModelChoice
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.estimation.model_error import having_error, relative_misfit
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.summary import IntervalMethod, estimate_text, rows, test_in_words
from gmwm.measuring.inspection.findings import covariates_text, effect_text
from gmwm.recording.signals import Imu
from gmwm.showing.plots.labels import axis_title
from gmwm.theory.processes import Model, Process, registry
from gmwm.theory.processes.parameter import Fixed


def panel() -> list[Any]:
    """Return the components of the tab."""
    terms = {name: f"{name}: {kind.title}" for name, kind in registry.items()}
    return [
        html.Div(id="axes", className="chips", role="group", **{"aria-label": "Axis"}),
        widgets.group(
            "terms", html.Div(id="terms", className="chips"), widgets.menu("term", terms, next(iter(terms))),
            widgets.button("Add", "add"), html.Label("Model", htmlFor="model"),
            widgets.text_input("model", "2*GM + WN + RW"),
        ),
        html.P(id="error-model", className="error", role="alert"),
        widgets.group(
            "controls", widgets.button("Use for all axes of the sensor", "spread"),
            widgets.button("Let gmwm choose", "choose"),
        ),
        html.Div(id="fit"),
        html.H2("Models compared"),
        html.Div(id="ranking"),
    ]  # fmt: skip


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the tab."""
    for place, draw in (("axes", _axes), ("terms", _chips), ("fit", _fit), ("ranking", _ranking)):
        widgets.draws(app, desk, tab="model", place=place, draw=draw)

    def text(data: Any, _: int, shown: str, page: str, before: Any) -> tuple[Any, Any]:
        session = desk.session(data)
        if shown != "model" or not session.file:
            return no_update, no_update
        try:
            model = model_of(session, desk.workspace(page))
        except (GmwmError, OSError):
            return no_update, no_update
        # When a job ends, this callback runs too, but it must not replace what the user is typing.
        now = [data, model]
        return (no_update, no_update) if now == before else (model, now)

    app.callback(
        Output("model", "value"), Output("model-shown", "data"), Input("session", "data"), Input("revision", "data"),
        Input("tab", "data"), State("page", "data"), State("model-shown", "data"),
    )(text)  # fmt: skip

    def change(session: Session, *given: Any) -> Session | None:
        *_, typed, term, page = given
        done = [trigger for trigger in widgets.triggers() if trigger[2]]
        for hit, change_of, value in done:
            # If the user leaves the field without a change, the recommended model does not become a chosen model.
            if change_of != "n_blur" or typed != model_of(session, desk.workspace(page)):
                session = _apply_change(session, desk.workspace(page), hit, value, typed=str(typed or ""), term=term)
        return session if done else None

    inputs = [
        Input({"type": "axis", "axis": ALL}, "n_clicks"), Input({"type": "remove", "term": ALL}, "n_clicks"),
        Input({"type": "hold", "parameter": ALL}, "n_clicks"), Input({"type": "use", "model": ALL}, "n_clicks"),
        Input({"type": "held", "parameter": ALL}, "value"), Input({"type": "fitted", "axis": ALL}, "relayoutData"),
        Input("add", "n_clicks"), Input("model", "n_submit"), Input("model", "n_blur"), Input("spread", "n_clicks"),
        Input("choose", "n_clicks"),
    ]  # fmt: skip
    states = [State("model", "value"), State("term", "value"), State("page", "data")]
    widgets.changes(app, desk, inputs, change, states=states, errors=("model",))


def _apply_change(session: Session, workspace: Workspace, hit: Any, value: Any, *, typed: str, term: str) -> Session:
    """Return the session after an action of the user on this tab."""
    axis = axis_of(session, workspace)
    kind = hit["type"] if isinstance(hit, dict) else hit
    if kind == "axis":
        return session.with_(axis=hit["axis"])
    if kind == "choose":
        return session.with_model(axis, None)
    if kind == "use":
        return session.with_model(axis, hit["model"])
    model = model_of(session, workspace)
    if kind == "model":
        return session.with_model(axis, typed) if typed.strip() else session
    if not model:
        return session
    if kind == "spread":
        for other in _record(session, workspace):
            session = session.with_model(other, model) if sensor_of(other) == sensor_of(axis) else session
        return session
    if kind == "add":
        return session.with_model(axis, adding(model, term))
    fit = workspace.fit(session, axis).value
    if not isinstance(fit, Fit):
        return session
    if kind == "remove":
        return session.with_model(axis, removing(fit, hit["term"]))
    if kind == "hold":
        return session.with_model(axis, holding(fit, hit["parameter"]))
    if kind == "held":
        held = fit.parameters.get(hit["parameter"])
        if held is None or str(value) == estimate_text(held):
            return session  # The field was only created, possibly for a model that is no longer shown.
        return session.with_model(axis, held_at(fit, hit["parameter"], str(value)))
    return _apply_slider(session, axis, fit, value)


def _apply_slider(session: Session, axis: str, fit: Fit, relayout: dict[str, Any]) -> Session:
    """Return the session after the handle of a term was dragged, with the term held at the new position."""
    for k, term in enumerate(movable(fit)):
        x, y = (relayout.get(f"shapes[{k}].{name}") for name in ("xanchor", "yanchor"))
        if isinstance(x, int | float) and isinstance(y, int | float) and 1e-30 < min(x, y) <= max(x, y) < 1e30:
            process = axis_at(fit, term, (float(x), float(y)), session)
            return session.with_model(axis, replacing(fit, term, process))
    return session


def _record(session: Session, workspace: Workspace) -> tuple[str, ...]:
    job = workspace.recording(session)
    job.join(60)
    if job.error is not None:
        raise job.error
    return tuple(job.value.axes) if job.state == "done" else ()


def model_of(session: Session, workspace: Workspace) -> str:
    """Return the model that is shown: the model of the user, or the recommended model; "" if it is not known yet."""
    axis = axis_of(session, workspace)
    if axis in session.models:
        return session.models[axis]
    job = workspace.search(session, axis)
    job.join(SILENT_S)
    return job.value.ranking.recommended.structure if job.state == "done" else ""


def axis_of(session: Session, workspace: Workspace) -> str:
    """Return the axis that is shown: the axis that the user chose, or the first axis of the recording."""
    axes = _record(session, workspace)
    return session.axis if session.axis in axes else next(iter(axes), "")


def _axes(session: Session, workspace: Workspace, width: float) -> Any:
    here = axis_of(session, workspace)

    def show(recording: Imu) -> list[Any]:
        return [
            widgets.button(
                axis_title(axis), {"type": "axis", "axis": axis}, "chip axis",
                **{"aria-pressed": str(axis == here).lower()},
            )
            for axis in recording.axes
        ]  # fmt: skip

    return widgets.of_job(workspace.recording(session), show)


def _chips(session: Session, workspace: Workspace, width: float) -> Any:
    def show(fit: Fit) -> list[Any]:
        return [
            widgets.button([term, html.Span(" ×")], {"type": "remove", "term": term}, "chip", title=f"Remove {term}")
            for term in fit.model.terms
        ]

    return widgets.of_job(workspace.fit(session, axis_of(session, workspace)), show)


def _fit(session: Session, workspace: Workspace, width: float) -> Any:
    axis = axis_of(session, workspace)
    chosen = "your model" if axis in session.models else "the model that gmwm recommends"

    def show(fit: Fit) -> list[Any]:
        figure = fit_figure(fit, session, min(width, 1360) - 40)
        residual = residual_figure(fit, session, min(width, 1360) - 40)
        return [
            html.H2(f"{axis_title(axis)}: {chosen}"),
            html.P(_regression_note(fit, session, workspace), className="hint", id="measured"),
            html.P("Drag a coloured handle to fix its term there.", className="hint"),
            widgets.graph(
                figure, {"type": "fitted", "axis": axis}, f"Fit of {axis_title(axis)}", edits={"shapePosition": True}
            ),
            widgets.graph(residual, "residual", f"Distance of the model of {axis_title(axis)} from the data, by scale"),
            html.Div([widgets.of_job(intervals, partial(_parameters, fit, session)), _tests(fit)], className="beside"),
            widgets.remarks(fit.remarks),
        ]

    comes = "the curve of the axis with its model, the parameters and the tests"
    fitted, intervals = workspace.fit(session, axis), workspace.intervals(session, axis)
    return widgets.of_job(fitted, show, comes=comes)


def _regression_note(fit: Fit, session: Session, workspace: Workspace) -> str:
    """Return a sentence that states which wavelet variance is fitted, and which effects were removed from it."""
    data = workspace.data(session).value[fit.wavelet_variance.axis]
    curve = "robust" if fit.wavelet_variance.robust else "classical"
    regression, removed = data.regression, ""
    if regression is not None and regression.applied:
        removed = f" without the effect of {covariates_text(regression)}, {effect_text(regression)}"
    return f"As gmwm calibrate does, this page fits the {curve} curve{removed}."


def _parameters(fit: Fit, session: Session, intervals: dict[str, Interval]) -> Any:
    shown = []
    for row in rows(fit, intervals, IntervalMethod(session.confidence)):
        held = row.name in fit.model.fixed_names
        value: Any = row.estimate
        if held:
            name = {"type": "held", "parameter": row.name}
            value = html.Label(
                [html.Span(f"Value of {row.name}", className="unseen"), widgets.text_input(name, "", row.estimate)]
            )
        hold = widgets.button("Free" if held else "Fix", {"type": "hold", "parameter": row.name}, "small")
        shown.append([row.name, hold, value, row.interval, row.unit])
    level = f"{100 * session.confidence:g} % interval"
    return widgets.table(["Parameter", "", "Estimate", level, "Unit"], shown, "numbers parameters")


def _tests(fit: Fit) -> Any:
    deviation = relative_misfit(fit)
    sampled = replace(fit, wavelet_variance=having_error(fit.wavelet_variance, 0.0))  # the test includes no model error
    _, test = test_in_words(sampled, IntervalMethod())
    gap = "no certificate" if fit.gap is None else f"proven within {gap_text(fit.gap)} of the objective"
    misfit_text = "none"
    if deviation.largest > 0:
        misfit_text = f"{100 * deviation.rms:.2g} % rms, {100 * deviation.largest:.2g} % at {deviation.tau:.3g} s"
    facts = {
        "Goodness of fit": test,
        "Global optimum": gap,
        "Relative misfit beyond chance": misfit_text,
        "Objective": f"{fit.objective:.5g}",
    }
    return html.Dl([html.Div([html.Dt(name), html.Dd(text)]) for name, text in facts.items()], className="facts")


def _ranking(session: Session, workspace: Workspace, width: float) -> Any:
    axis = axis_of(session, workspace)

    def show(choice: ModelChoice) -> list[Any]:
        ranking, listed = choice.ranking, []
        for candidate in ranking.distinct[:12]:
            mark = "recommended" if candidate.recommended else "equivalent" if candidate.equivalent else ""
            pvalue = "" if candidate.pvalue is None else p_text(candidate.pvalue)
            use = widgets.button(
                "Use", {"type": "use", "model": candidate.structure}, "small", title=f"Use {candidate.structure}"
            )
            listed.append([round_fixed(ranking.label(candidate)), use, f"{candidate.difference:.2f}", pvalue, mark])
        return [widgets.table(["Model", "", "WIC − best", "p of the fit", ""], listed, "numbers ranking")]

    return widgets.of_job(workspace.search(session, axis), show, comes="the models that gmwm compared, the best first")


def adding(model: str, term: str) -> str:
    """Return a model with a term added."""
    processes = (*Model.parse(model).processes, *Model.parse(term).processes)
    names = [process.name for process in processes]
    return str(Model(tuple(sorted(processes, key=lambda process: names.index(process.name)))))


def removing(fit: Fit, term: str) -> str:
    """Return the model of a fit without a term."""
    remaining = tuple(process for name, process in _terms(fit).items() if name != term)
    if not remaining:
        raise OptionError(
            "a model needs at least one term", argument="model", got=term, advice="Add another term first."
        )
    return str(Model(remaining))


def holding(fit: Fit, parameter: str) -> str:
    """Return the model of a fit with a parameter held fixed at its estimate. If it was held before, it becomes free."""
    term, _, name = _parts(fit, parameter)
    process = _terms(fit)[term]
    value = None if process.is_fixed(name) else Fixed(fit.parameters[parameter])
    return replacing(fit, term, process.with_values(**{name: value}))


def held_at(fit: Fit, parameter: str, text: str) -> str:
    """Return the model of a fit with a parameter held fixed at a given value."""
    term, _, name = _parts(fit, parameter)
    try:
        value = float(text)
    except ValueError:
        raise OptionError(argument="model", expected=f"a number for {parameter}", got=text) from None
    return replacing(fit, term, _terms(fit)[term].with_values(**{name: Fixed(value)}))


def _parts(fit: Fit, parameter: str) -> tuple[str, str, str]:
    """Divide the name of a parameter of a fit into term, point and name."""
    if parameter not in fit.parameters:
        raise OptionError(argument="model", expected=f"one of {', '.join(fit.parameters)}", got=parameter)
    return parameter.rpartition(".")


def replacing(fit: Fit, term: str, process: Process) -> str:
    """Return the model of a fit with the process of a term replaced."""
    return str(Model(tuple((_terms(fit) | {term: process}).values())))


def _terms(fit: Fit) -> dict[str, Process]:
    """Return the processes of a fit by term, with values for the held parameters only."""
    return {
        term: process.with_values(**{p.name: None for p in process.parameters if not process.is_fixed(p.name)})
        for term, process in fit.model.by_term.items()
    }
