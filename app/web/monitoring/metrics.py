"""Count requests, times and waiting votes for Prometheus, over all workers.

Labels are routes, statuses and names of failing films; never addresses, which hold invitations and sign-in links.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.multiprocess import MultiProcessCollector, mark_process_dead

SHARED_FOLDER = "PROMETHEUS_MULTIPROC_DIR"  # where workers keep their counts, by prometheus_client's convention
FAILING_FILM = ("study", "film", "browser")
LATENCY_BUCKETS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)


class Metrics:
    """The counts of one server process."""

    def __init__(self, n_waiting: Callable[[], int]) -> None:
        self._registry = CollectorRegistry()
        self.requests = Counter(
            "reconstudy_requests", "Answered requests.", ("method", "route", "status"), registry=self._registry
        )
        self.seconds = Histogram(
            "reconstudy_request_seconds",
            "Time to the first byte of the answer.",
            ("route",),
            buckets=LATENCY_BUCKETS_S,
            registry=self._registry,
        )
        self.film_failures = Counter(
            "reconstudy_film_failures", "Films that a participant's browser could not show.", registry=self._registry
        )
        self._count_of = cache(lambda method, route, status: self.requests.labels(method, route, str(status)))
        self._times_of = cache(self.seconds.labels)  # cached, because finding a label takes longer than counting
        self._n_waiting = n_waiting
        self._is_shared = SHARED_FOLDER in os.environ
        self._waiting = Gauge(
            "reconstudy_votes_waiting",
            "Votes that wait for the writer.",
            multiprocess_mode="livesum",
            registry=self._registry,
        )

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        self._count_of(method, route, status).inc()
        self._times_of(route).observe(seconds)
        if self._is_shared:
            self._waiting.set(self._n_waiting())

    def text(self) -> tuple[bytes, str]:
        """Write out the counts of all workers; returns the text and its media type."""
        self._waiting.set(self._n_waiting())
        if not self._is_shared:
            return generate_latest(self._registry), CONTENT_TYPE_LATEST
        _forget_the_dead(Path(os.environ[SHARED_FOLDER]))
        shared = CollectorRegistry()
        MultiProcessCollector(shared)  # type: ignore[no-untyped-call]  # the package has none there
        return generate_latest(shared), CONTENT_TYPE_LATEST


def failing_films_text(failing: Iterable[tuple[tuple[str, str, str], int]]) -> bytes:
    """Write how many people could not be shown a film, by study, film and browser, until somebody takes note."""
    told = "People to whom a film could not be shown, until an experimenter takes note of it."
    gauge = GaugeMetricFamily("reconstudy_failing_film_people", told, labels=FAILING_FILM)
    for labels, n_people in failing:
        gauge.add_metric(labels, n_people)
    return generate_latest(_OneMetric(gauge))


class _OneMetric(CollectorRegistry):
    """A registry of a metric that is read from the database, the same for all workers."""

    def __init__(self, metric: GaugeMetricFamily) -> None:
        super().__init__()
        self._metric = metric

    def collect(self) -> Iterable[GaugeMetricFamily]:
        return [self._metric]


def _forget_the_dead(folder: Path) -> None:
    """Drop the waiting votes of dead workers; their other counts stay."""
    for path in folder.glob("gauge_live*_*.db"):
        pid = int(path.stem.rpartition("_")[2])
        if not Path(f"/proc/{pid}").exists():
            mark_process_dead(pid)  # type: ignore[no-untyped-call]  # the package has none there
