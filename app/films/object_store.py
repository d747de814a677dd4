"""Serve the pair videos to browsers from an object store or a public host (CDN) instead of this server.

`RECONSTUDY_MEDIA_ACCEL=/pairs/`: nginx sends the file (X-Accel-Redirect, deploy/nginx.conf).
`RECONSTUDY_MEDIA_URL=s3://bucket/folder`: any object store of fsspec that signs addresses; browsers are redirected to
an address valid for an hour. fsspec's settings give its endpoint and keys: `FSSPEC_S3_ENDPOINT_URL`,
`AWS_ACCESS_KEY_ID`, … An https:// address means a public host of the same files, such as a CDN.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import fsspec

SIGNED_FOR_S = 3600
PUBLIC = ("http", "https")


class MediaStore:
    """The object store or public host that holds the pair videos.

    Raises
    ------
    ValueError
        If browsers cannot be redirected to an address of this kind, or its package or the keys are missing.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self.is_public = urlsplit(url).scheme in PUBLIC
        if self.is_public:
            return
        with self._errors():
            self._files, self._folder = fsspec.core.url_to_fs(self.url)
            self.address("probe")

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Raise a ValueError that names the setting in place of what the store's package raises."""
        try:
            yield
        except NotImplementedError as error:
            raise ValueError(
                f"RECONSTUDY_MEDIA_URL={self.url}: this kind of store gives no addresses to browsers; expected s3://, "
                "gs://, abfs:// or the https:// address of a public host"
            ) from error
        except Exception as error:  # each package has errors of its own: a host that is away, keys that are missing
            raise ValueError(f"RECONSTUDY_MEDIA_URL={self.url}: {error}") from error

    def address(self, file: str) -> str:
        """Return a file's address for browsers; it is valid for an hour unless the host is public."""
        if self.is_public:
            return f"{self.url}/{file}"
        return str(self._files.sign(f"{self._folder}/{file}", expiration=SIGNED_FOR_S))

    @property
    def origin(self) -> str:
        """Origin that a page's content security policy must allow."""
        parts = urlsplit(self.address("probe"))
        return f"{parts.scheme}://{parts.netloc}"

    def upload(self, paths: Iterable[Path]) -> int:
        """Upload missing files and return their number; a public host is filled by other means."""
        if self.is_public:
            return 0
        with self._errors():
            missing = [path for path in paths if not self._has(path)]
            for path in missing:
                self._files.put_file(str(path), f"{self._folder}/{path.name}")
        return len(missing)

    def _has(self, path: Path) -> bool:
        try:
            facts: dict[str, Any] = self._files.info(f"{self._folder}/{path.name}")
        except FileNotFoundError:
            return False
        return bool(facts["size"] == path.stat().st_size)
