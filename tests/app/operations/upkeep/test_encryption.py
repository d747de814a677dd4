"""A backup that was encrypted opens to its private key alone; the server, which made it, cannot read it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from app.operations.studies import manage
from app.operations.upkeep import backup as backup_module
from app.operations.upkeep.backup import back_up, restore
from app.settings import Settings

LOCKED = (Path(__file__).parents[4] / "requirements.lock").read_text(encoding="utf-8")
if "pyrage==" in LOCKED:  # from then on the tests need it
    import pyrage
else:
    pyrage = pytest.importorskip("pyrage")

NAME = "Ada Lovelace of the green lighthouse"


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """A server with somebody in its database, and the owner's key and a stranger's beside it."""
    settings = Settings(data_dir=tmp_path / "data")
    manage.add_experimenter(settings, NAME)
    for owner in ("mine", "strange"):
        identity = pyrage.x25519.Identity.generate()
        (tmp_path / f"{owner}.key").write_text(f"# created by age-keygen\n{identity}\n")
        (tmp_path / f"{owner}.pub").write_text(f"# public key\n{identity.to_public()}\n")
    return settings


def restored(path: Path, identity: Path | None, tmp_path: Path) -> list[str]:
    there = Settings(data_dir=tmp_path / "there")
    restore(there, path, identity=identity)
    assert sorted(each.name for each in there.data_dir.iterdir() if each.name.startswith(".")) == []
    return [row["name"] for row in manage.list_experimenters(there)]


@pytest.mark.slow
def test_a_backup_that_was_encrypted_comes_back_by_its_key_alone(settings: Settings, tmp_path: Path) -> None:
    backup = tmp_path / "backup.zip.age"
    assert back_up(settings, backup, encrypt_to=[str(tmp_path / "mine.pub")])["encrypted"] is True
    assert not backup.read_bytes().startswith(b"PK")
    assert sorted(path.name for path in tmp_path.iterdir() if "backup" in path.name) == [backup.name]  # no plain one
    assert backup.stat().st_mode & 0o777 == 0o600
    with pytest.raises(ValueError, match="is encrypted; name the file of a private key that opens it: --identity FILE"):
        restored(backup, None, tmp_path)
    with pytest.raises(ValueError, match=r"cannot be decrypted by .*strange\.key"):
        restored(backup, tmp_path / "strange.key", tmp_path)
    with pytest.raises(ValueError, match=r"mine\.pub: is no private key"):
        restored(backup, tmp_path / "mine.pub", tmp_path)
    assert restored(backup, tmp_path / "mine.key", tmp_path) == [NAME]


@pytest.mark.slow
def test_no_file_is_readable_while_a_backup_is_encrypted_or_restored(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that is killed meanwhile leaves what the disk holds then."""
    backup, there, plain = tmp_path / "backup.zip.age", Settings(data_dir=tmp_path / "there"), []

    def look(name: str) -> None:
        function = getattr(backup_module, name)

        def looking(*arguments: Any, **options: Any) -> Any:
            files = [path for path in tmp_path.rglob("*") if path.is_file()]
            plain.append([path.name for path in files if path.read_bytes().startswith(b"PK")])
            return function(*arguments, **options)

        monkeypatch.setattr(backup_module, name, looking)

    for name in ("encrypt", "read_tables"):
        look(name)
    back_up(settings, backup, encrypt_to=[str(tmp_path / "mine.pub")])
    restore(there, backup, identity=tmp_path / "mine.key")
    assert plain == [[], []]


def test_a_damaged_encrypted_backup_is_refused(settings: Settings, tmp_path: Path) -> None:
    backup = tmp_path / "backup.zip.age"
    back_up(settings, backup, encrypt_to=[(tmp_path / "mine.pub").read_text().splitlines()[1]])
    content = bytearray(backup.read_bytes())
    content[-20] ^= 1
    backup.write_bytes(content)
    with pytest.raises(ValueError, match="cannot be decrypted"):
        restored(backup, tmp_path / "mine.key", tmp_path)


@pytest.mark.slow
def test_the_settings_encrypt_every_backup(settings: Settings, tmp_path: Path) -> None:
    always = settings.model_copy(update={"backup_encrypt_to": str(tmp_path / "mine.pub")})
    back_up(always, tmp_path / "nightly.age", encrypt_to=[str(tmp_path / "strange.pub")])
    for owner in ("mine", "strange"):  # either opens it
        assert restored(tmp_path / "nightly.age", tmp_path / f"{owner}.key", tmp_path / owner) == [NAME]


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ("age1nonsense", "'age1nonsense' is no public key"),
        ("missing.pub", "missing.pub: cannot be read; expected a public key such as age1"),
    ],
)
def test_what_is_no_public_key_is_refused_before_anything_is_written(
    settings: Settings, tmp_path: Path, given: str, complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        back_up(settings, tmp_path / "backup.zip", encrypt_to=[given])
    assert not (tmp_path / "backup.zip").exists()


@pytest.mark.parametrize("as_file", [True, False])
def test_a_private_key_in_place_of_a_public_one_is_not_repeated(
    settings: Settings, tmp_path: Path, *, as_file: bool
) -> None:
    """What a command says may stand in a log."""
    private = (tmp_path / "mine.key").read_text().splitlines()[1]
    given = str(tmp_path / "mine.key") if as_file else private
    with pytest.raises(ValueError, match=r"is a private key, expected a public key") as refused:
        back_up(settings, tmp_path / "backup.zip", encrypt_to=[given])
    assert private[:30] not in str(refused.value)
