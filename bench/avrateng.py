"""A server that keeps votes as avrateNG does, for bench/server.py to be measured beside.

    python bench/avrateng.py PORT DATABASE

It has avrateNG's parts (bottle on wsgiref, which takes one request at a time and writes a line for each) and does what
its `saveRating` does: a connection to SQLite for each vote, then two tables, each made if it is not there, each with a
commit of its own: the rating, and how it was come to. It leaves out the sign-in, the cookies and the page that follows.
"""

from __future__ import annotations

import json
import sqlite3
import sys
from contextlib import closing
from datetime import UTC, datetime

import bottle

RATING = "user_ID INTEGER, video_ID TEXT, video_name TEXT, rating_type TEXT, rating TEXT, timestamp TEXT"
TRACKER = "user_ID INTEGER, video_ID TEXT, video_name TEXT, tracker TEXT"


def keep(database: str, trial: str) -> str:
    content = bottle.request.json
    with closing(sqlite3.connect(database)) as connection:
        connection.execute(f"CREATE TABLE IF NOT EXISTS ratings ({RATING})")
        rating = (1, trial, content["id"], "choice", content["choice"], str(datetime.now(UTC)))
        connection.execute("INSERT INTO ratings VALUES (?, ?, ?, ?, ?, ?)", rating)
        connection.commit()
        connection.execute(f"CREATE TABLE IF NOT EXISTS tracker ({TRACKER})")
        connection.execute("INSERT INTO tracker VALUES (?, ?, ?, ?)", (*rating[:3], json.dumps(content["viewing"])))
        connection.commit()
    bottle.response.status = 201
    return ""


def main() -> None:
    _, port, database = sys.argv
    bottle.route("/api/v1/session/trials/<trial>/vote", "PUT", lambda trial: keep(database, trial))
    bottle.run(host="127.0.0.1", port=int(port))


if __name__ == "__main__":
    main()
