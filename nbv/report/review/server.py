# SPDX-License-Identifier: MIT
"""Server of the review page: on this machine alone, for who has the token; it answers in JSON."""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from werkzeug.exceptions import BadRequest, Forbidden, HTTPException, NotFound
from werkzeug.serving import BaseWSGIServer, WSGIRequestHandler, make_server
from werkzeug.wrappers import Request, Response

from completion.result.completion import Completion
from nbv.report.review.asking import distance_between, facts_of, rectangle, snaps_at, surface_at
from nbv.report.review.page_text import page_text
from nbv.report.review.session import ReviewSession
from nbv.report.review.standing import stand_for
from nbv.report.review.view import first_view, view_after
from nbv.report.viewer.encoding import encode_view
from nbv.report.viewer.layers import Viewer
from nbv.scanning.sensor import Sensor
from scenes.checks import FloatArray, InputError, check_coordinates
from scenes.run.atomic import json_text

_HOST = "127.0.0.1"
_MOST_BYTES = 1 << 20  # of a question
_KEPT = 4  # views that are kept as they are sent
_SAFE = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}


@dataclass(slots=True, eq=False)
class ReviewServer:
    """The page of one session, at an address with a token.

    Attributes
    ----------
    session : ReviewSession
        What is reviewed.
    title : str
        What it is called.
    sensor : Sensor
        What scans next.
    save : callable
        Writes the outputs; what it returns is told.
    """

    session: ReviewSession
    title: str
    sensor: Sensor
    save: Callable[[], list[str]]
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    first: Viewer | None = None
    _encoded: list[tuple[Completion, str]] = field(default_factory=list)
    _drawing: threading.Lock = field(default_factory=threading.Lock)

    def listen(self, port: int = 0) -> BaseWSGIServer:
        """Return the server, bound to the loopback address; port 0 is any that is free.

        Raises InputError: the port is taken.
        """
        try:
            return make_server(_HOST, port, self, threaded=True, request_handler=_Silent)
        except (OSError, SystemExit) as error:
            raise InputError(f"port {port} of {_HOST} cannot be used; give another --port") from error

    def address(self, port: int) -> str:
        """Return the page's address."""
        return f"http://{_HOST}:{port}/{self.token}/"

    def __call__(self, environ: dict[str, Any], start: Callable[..., Any]) -> Any:
        """Answer a request (WSGI)."""
        request = Request(environ)
        try:
            response = self._answer(request)
        except HTTPException as error:
            response = _json({"error": error.description}, int(error.code or 500))
        except InputError as error:
            response = _json({"error": str(error)}, 422)
        for name, value in _SAFE.items():
            response.headers.setdefault(name, value.replace("{nonce}", ""))
        return response(environ, start)

    def _answer(self, request: Request) -> Response:
        self._check(request)
        question = request.path.removeprefix(f"/{self.token}/")
        if request.method == "GET":
            if question == "":
                return self._page()
            if question == "state":
                return _json(self._state())
            if question in ("view", "trial-view"):
                return Response(self._view(is_trial=question == "trial-view"), mimetype="text/plain")
            raise NotFound("there is no such page")
        known: dict[str, Callable[[Mapping[str, Any]], Any]] = {
            "ask": self._ask, "measure": self._measure, "snaps": self._snaps, "rectangle": self._rectangle,
            "try": self._try, "take": self._take, "undo": self._undo, "redo": self._redo,
            "stand": self._stand, "save": self._save,
        }  # fmt: skip
        if request.method != "POST" or question not in known:
            raise NotFound("there is no such question")
        return _json(known[question](_body(request)))

    def _check(self, request: Request) -> None:
        """Refuse who has no token, comes from another page, or by another name than the loopback address."""
        host = request.host.rpartition(":")[0] or request.host
        if host not in (_HOST, "localhost"):
            raise Forbidden("this server answers on this machine alone")
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{request.host}":
            raise Forbidden("this server answers its own page alone")
        given = request.path.split("/", 2)[1] if request.path.count("/") >= 2 else ""
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            raise Forbidden("the address lacks the token that `unseen review` printed")

    def _page(self) -> Response:
        nonce = secrets.token_urlsafe(16)
        response = Response(page_text(self.title, nonce), mimetype="text/html")
        response.headers.update({name: text.replace("{nonce}", nonce) for name, text in _SAFE.items()})
        return response

    def _state(self) -> dict[str, Any]:
        """What the lists show."""
        session, completion = self.session, self.session.completion
        related = completion.relations
        return {
            "title": self.title,
            "version": session.version,
            "said": session.said,
            "undone": len(session.undone),
            "surfaces": [
                {
                    "number": number,
                    "kind": patch.grid.surface.kind,
                    "measured_m2": patch.observed_m2,
                    "inferred_m2": patch.hypothesised_m2,
                    "anchor": completion.anchor(number),
                    "drawn": self._drawn(completion.anchor(number)[None])[0],
                    "edits": list(patch.verdict.actions),
                }
                for number, patch in enumerate(completion.patches, start=1)
            ],
            "relations": []
            if related is None
            else [
                {
                    "kind": one.kind.replace("_", " "),
                    "surfaces": [related.numbers[k] or 0 for k in one.surfaces],
                    "status": one.status.value,
                    "p": one.p,
                    "given": one.is_given,
                    "reason": one.reason,
                }
                for one in related.graph.relations
            ],
            "warnings": list(completion.warnings),
            "measured_m2": completion.observed_m2,
            "inferred_m2": completion.hypothesised_m2,
        }

    def _view(self, *, is_trial: bool) -> str:
        """The 3-D view, encoded."""
        with self._drawing:
            tried = self.session.tried
            completion = tried[1] if is_trial and tried is not None else self.session.completion
            if self.first is None:
                self.first = first_view(self.session.completion)
            for held, text in self._encoded:
                if held is completion:
                    return text
            text = encode_view(view_after(self.first, completion))
            self._encoded = [(completion, text), *self._encoded[: _KEPT - 1]]
            return text

    def _drawn(self, places: FloatArray) -> FloatArray:
        """Places (n, 3) of the world in coordinates of drawings, z up, as the page has them."""
        return self.session.completion.up.drawing_from_world.apply(places)

    def _world(self, places: object, n: int | None = None) -> FloatArray:
        """Places (n, 3) of the page in world coordinates."""
        found = np.atleast_2d(check_coordinates(places))
        if found.ndim != 2 or found.shape[1] != 3 or (n is not None and len(found) != n):
            raise InputError(f"places are lists of three numbers, {n or 'any number'} of them")
        return self.session.completion.up.drawing_from_world.inverse().apply(found)

    def _ask(self, asked: Mapping[str, Any]) -> Any:
        completion = self.session.completion
        if "surface" in asked:
            return facts_of(completion, int(asked["surface"]))
        place = self._world(asked.get("place"), 1)[0]
        number = surface_at(completion, place)
        return {"surface": None} if number is None else facts_of(completion, number, place)

    def _measure(self, asked: Mapping[str, Any]) -> Any:
        return distance_between(self.session.completion, self._world(asked.get("places"), 2))

    def _snaps(self, asked: Mapping[str, Any]) -> Any:
        place = self._world(asked.get("place"), 1)[0]
        return [asdict(one) for one in snaps_at(self.session.completion, int(asked["surface"]), place)]

    def _rectangle(self, asked: Mapping[str, Any]) -> Any:
        places = self._world(asked.get("places"), 2)
        return rectangle(self.session.completion, int(asked["surface"]), places).tolist()

    def _try(self, asked: Mapping[str, Any]) -> Any:
        return self.session.try_out(_statement(asked)).to_json()

    def _take(self, asked: Mapping[str, Any]) -> Any:
        self.session.take(_statement(asked))
        return self._state()

    def _undo(self, _: Mapping[str, Any]) -> Any:
        self.session.undo()
        return self._state()

    def _redo(self, _: Mapping[str, Any]) -> Any:
        self.session.redo()
        return self._state()

    def _stand(self, asked: Mapping[str, Any]) -> Any:
        return stand_for(self.session.completion, int(asked["surface"]), self.sensor)

    def _save(self, _: Mapping[str, Any]) -> Any:
        return {"written": self.save()}


class _Silent(WSGIRequestHandler):
    """Says nothing of requests: addresses hold the token."""

    def log(self, type: str, message: str, *args: Any) -> None:  # noqa: A002 - the library's name
        """Say nothing."""


def _body(request: Request) -> Mapping[str, Any]:
    """The question's JSON object."""
    if request.mimetype != "application/json":
        raise BadRequest("send JSON")
    if (request.content_length or 0) > _MOST_BYTES:
        raise BadRequest("the question is too long")
    try:
        held = json.loads(request.get_data(cache=False) or b"{}")
    except (ValueError, RecursionError):
        raise BadRequest("this is no JSON") from None
    if not isinstance(held, dict):
        raise BadRequest("send a JSON object")
    return held


def _statement(asked: Mapping[str, Any]) -> Mapping[str, Any]:
    held = asked.get("statement")
    if not isinstance(held, dict) or not ("do" in held or "type" in held):
        raise InputError('give a "statement" with a "do" or a "type"')
    return held


def _json(value: object, status: int = 200) -> Response:
    return Response(json_text(value, indent=None), status=status, mimetype="application/json")
