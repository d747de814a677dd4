"""Encrypt backups to public keys by age (https://age-encryption.org): the server that makes them cannot read them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

PRIVATE_KEY = "AGE-SECRET-KEY-"
HEADER = b"age-encryption.org/v1"  # begins every encrypted file
EXPECTED = "a public key such as age1… or ssh-ed25519 …, or a file of them"


def read_recipients(given: Sequence[str]) -> list[Any]:
    """Read public keys, or files that hold one a line.

    Raises
    ------
    ValueError
        If one is no public key, or a file holds none.
    """
    from pyrage import RecipientError, ssh, x25519

    recipients = []
    for text in given:
        is_key = text.startswith(("age1", "ssh-", PRIVATE_KEY))
        keys = [text.strip()] if is_key else list(_lines(Path(text), EXPECTED))
        for number, key in enumerate(keys, start=1):
            where = "" if is_key else f"{text}, key {number}: "
            if key.startswith(PRIVATE_KEY):  # not repeated: messages stand in logs
                raise ValueError(f"{where}this is a private key, expected {EXPECTED}")
            try:
                recipients.append((ssh if key.startswith("ssh-") else x25519).Recipient.from_str(key))
            except RecipientError as error:
                raise ValueError(f"{where}{key[:60]!r} is no public key ({error}); expected {EXPECTED}") from error
    return recipients


def encrypt(plain: IO[bytes], encrypted: IO[bytes], recipients: Sequence[Any]) -> None:
    """Encrypt what a file holds to public keys, any of whose owners can decrypt it."""
    from pyrage import encrypt_io

    encrypt_io(plain, encrypted, list(recipients))


def is_encrypted(path: Path) -> bool:
    """Say whether a file was encrypted by age."""
    with path.open("rb") as file:
        return file.read(len(HEADER)) == HEADER


def decrypt(encrypted: Path, plain: IO[bytes], identity: Path) -> None:
    """Decrypt a file by a private key.

    Parameters
    ----------
    encrypted : the file
    plain : open file to write to
    identity : file of the private key: one of age-keygen, or an SSH key without a passphrase

    Raises
    ------
    ValueError
        If the file holds no private key, or the key does not open what was encrypted, or that is damaged.
    """
    from pyrage import DecryptError, IdentityError, decrypt_io, ssh, x25519

    lines = list(_lines(identity, "a private key such as AGE-SECRET-KEY-1…"))
    try:
        if lines[0].startswith("-----BEGIN"):
            identities: list[Any] = [ssh.Identity.from_buffer(identity.read_bytes())]
        else:
            identities = [x25519.Identity.from_str(line) for line in lines]
    except IdentityError as error:
        raise ValueError(f"{identity}: is no private key of age or SSH: {error}") from error
    try:
        with encrypted.open("rb") as source:
            decrypt_io(source, plain, identities)
    except (DecryptError, OSError) as error:  # OSError: what was encrypted is damaged
        raise ValueError(f"{encrypted}: cannot be decrypted by {identity}: {error}") from error


def _lines(path: Path, expected: str) -> Iterator[str]:
    """Yield the lines of a file of keys that are no comments."""
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read; expected {expected}") from error
    keys = [line for line in lines if line and not line.startswith("#")]
    if not keys:
        raise ValueError(f"{path}: holds no key, expected {expected}")
    yield from keys
