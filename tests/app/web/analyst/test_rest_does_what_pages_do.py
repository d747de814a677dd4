"""Whatever a form of the dashboard does, a program does over REST, or there is a reason why it does not."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from app.main import create_app
from app.settings import Settings
from tests.app.web.http_checks import all_routes

ONES_OWN = "a person's own way in: a program has a token"
OWNERS = "who may come in is an owner's to say: a token gives out no access; `reconstudy admin` and `token` do"
BY_HAND = "drawn by hand; a program masks by the job `segment`, or sends masks in the capture"
A_LOOK = "a look at the participant's page, in a browser"
SAME: dict[str, str] = {  # form of the dashboard: route below /api/v1, or why there is none
    **dict.fromkeys(("POST /account/password", "POST /logout", "POST /sign-in", "POST /login/{secret}"), ONES_OWN),
    **dict.fromkeys(("POST /account/second-factor", "POST /account/second-factor/confirm"), ONES_OWN),
    **dict.fromkeys(("POST /account/second-factor/end", "POST /account/sessions/end"), ONES_OWN),
    **dict.fromkeys(("POST /account/sessions/end-all", "POST /setup/{secret}"), ONES_OWN),
    **dict.fromkeys(("POST /tokens", "POST /tokens/revoke", "POST /users", "POST /users/disable"), OWNERS),
    **dict.fromkeys(("POST /users/link", "POST /users/role", "POST /users/second-factor"), OWNERS),
    "POST /users/studies": OWNERS,
    "PUT /files/captures/{name}/strokes/{sensor}/{side}/{frame}": BY_HAND,
    "POST /files/captures/{name}/strokes/{sensor}/{side}/{frame}/mask": BY_HAND,
    "POST /studies/{slug}/preview": A_LOOK,
    "POST /files/upload": "POST /uploads",
    "PATCH /files/upload/{upload}": "PATCH /uploads/{upload}",
    "POST /files/upload/{upload}/discard": "DELETE /uploads/{upload}",
    "POST /files/votes/{name}/analyse": "POST /votes",
    "POST /files/{kind}/{name}/attach": "POST /files/{kind}/{name}/attach",
    "POST /files/{kind}/{name}/delete": "DELETE /files/{kind}/{name}",
    "POST /jobs/{task}/cancel": "DELETE /tasks/{task}",
    "POST /tasks/{task}/cancel": "DELETE /tasks/{task}",
    "POST /work/new/{kind}": "POST /jobs",
    "POST /work/{job}/cancel": "POST /jobs/{job}/cancel",
    "POST /work/{job}/retry": "POST /jobs/{job}/retry",
    "PUT /stimuli/upload": "POST /sets",
    "POST /sets/{name}/delete": "DELETE /sets/{name}",
    "POST /sets/{name}/factors": "PATCH /sets/{name}",
    "POST /sets/{name}/name": "PATCH /sets/{name}",
    "PUT /studies/import": "POST /studies/import",
    "POST /studies/new": "POST /studies",
    "POST /studies/new/file": "POST /studies",
    "POST /studies/new/draft": "PUT /drafts/{stimulus_set}",
    "POST /studies/new/drop": "DELETE /drafts/{stimulus_set}",
    "POST /studies/{slug}/address": "PUT /studies/{slug}/address",
    "POST /studies/{slug}/duplicate": "POST /studies/{slug}/duplicate",
    "POST /studies/{slug}/edit": "PATCH /studies/{slug}",
    "POST /studies/{slug}/edit/file": "PATCH /studies/{slug}",
    "POST /studies/{slug}/invitations/groups": "PATCH /studies/{slug}",
    "POST /studies/{slug}/texts/languages": "PATCH /studies/{slug}",
    "POST /studies/{slug}/state": "PUT /studies/{slug}/state",
    "POST /studies/{slug}/failures": "DELETE /studies/{slug}/failures",
    "POST /studies/{slug}/stimuli": "POST /studies/{slug}/check",
    "POST /studies/{slug}/stimuli/again": "POST /studies/{slug}/films",
    "PUT /studies/{slug}/upload": "POST /studies/{slug}/results",
    "POST /studies/{slug}/texts": "PUT /studies/{slug}/texts/{language}",
    "POST /studies/{slug}/texts/images": "PUT /studies/{slug}/images/{name}",
    "POST /studies/{slug}/texts/images/{name}/remove": "DELETE /studies/{slug}/images/{name}",
    "POST /studies/{slug}/invitations": "POST /studies/{slug}/invitations",
    "POST /studies/{slug}/invitations/people": "POST /studies/{slug}/invitations",
    "POST /studies/{slug}/invitations/{code}/end": "DELETE /studies/{slug}/invitations/{code}",
    "POST /studies/{slug}/invitations/{code}/label": "PATCH /studies/{slug}/invitations/{code}",
    "POST /studies/{slug}/participants/comments/tag": "PUT /studies/{slug}/comments/tag",
    "POST /studies/{slug}/participants/comments/tags": "PUT /studies/{slug}/comment_tags/{tag}",
    "POST /studies/{slug}/participants/comments/tags/delete": "DELETE /studies/{slug}/comment_tags/{tag}",
    "POST /studies/{slug}/participants/comments/tags/rename": "PATCH /studies/{slug}/comment_tags/{tag}",
    "POST /studies/{slug}/votes/{trial}/comment": "PUT /studies/{slug}/trials/{trial}/comment",
    "POST /studies/{slug}/participants/{label}/again": "POST /studies/{slug}/participants/{label}/again",
    "POST /studies/{slug}/participants/{label}/erase": "PUT /studies/{slug}/participants/{label}/erasure",
    "POST /studies/{slug}/participants/{label}/exclude": "PUT /studies/{slug}/participants/{label}/exclusion",
    "POST /studies/{slug}/participants/{label}/include": "DELETE /studies/{slug}/participants/{label}/exclusion",
    "POST /studies/{slug}/participants/{label}/interview": "PUT /studies/{slug}/participants/{label}/interview",
    "POST /studies/{slug}/participants/{label}/resume-code": "POST /studies/{slug}/participants/{label}/resume-code",
    "POST /studies/{slug}/participants/{label}/screening": "POST /studies/{slug}/participants/{label}/screening",
    "POST /studies/{slug}/participants/{label}/withdraw": "PUT /studies/{slug}/participants/{label}/withdrawal",
}


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[set[str], set[str]]]:
    """The forms of the dashboard, and the routes that OpenAPI describes."""
    app = create_app(Settings(data_dir=tmp_path_factory.mktemp("known")))
    forms = {
        f"{method} {str(route.path).removeprefix('/admin')}"
        for route in all_routes(app.routes)
        if str(getattr(route, "path", "")).startswith("/admin/")
        for method in route.methods - {"GET", "HEAD"}
    }
    described = {
        f"{method.upper()} {path.removeprefix('/api/v1')}"
        for path, operations in app.openapi()["paths"].items()
        for method in operations
    }
    yield forms, described
    app.state.database.dispose()


def test_what_a_form_does_a_program_does_too_or_there_is_a_reason(known: tuple[set[str], set[str]]) -> None:
    forms, described = known
    assert forms == SAME.keys(), "say in SAME which route does the same, or why none does"
    missing = {form: route for form, route in SAME.items() if "/" in route.split(" ")[1] and route not in described}
    assert missing == {}
