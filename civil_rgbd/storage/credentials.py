"""Who we are to S3: by the environment, else by a profile in ``~/.aws``, as everywhere."""

from __future__ import annotations

import configparser
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from civil_rgbd.errors import MissingExtraError, StorageError

_BY_SERVICE: Final = ("sso_session", "sso_start_url", "role_arn", "credential_process")
"""Keys of a profile whose credentials must be fetched."""

_WHO: Final = (
    "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE after `aws configure`; for a "
    "public bucket set AWS_SKIP_SIGNATURE=true"
)
_GOOGLE: Final = (
    "set GOOGLE_APPLICATION_CREDENTIALS to a key file, or run `gcloud auth application-default "
    "login`; for a public bucket set GOOGLE_SKIP_SIGNATURE=true"
)
_AZURE: Final = (
    "set AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY; for a public container set "
    "AZURE_SKIP_SIGNATURE=true"
)
_WHO_ELSE: Final = {"gs": _GOOGLE, "gcs": _GOOGLE, "az": _AZURE, "abfs": _AZURE}
"""By protocol: how to say who we are."""

_OF_THE_MACHINE: Final = (
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
)


@dataclass(frozen=True, slots=True)
class S3Settings:
    """How to speak to S3.

    Attributes:
        config: what the environment does not say itself.
        endpoint: URL of a server other than Amazon's.
        provider: fetches credentials that do not lie in a file.
    """

    config: dict[str, str] = field(default_factory=dict)
    endpoint: str | None = None
    provider: Any = None


def s3_settings(environment: Mapping[str, str]) -> S3Settings:
    """Find endpoint, region and credentials.

    Args:
        environment: of the process: ``AWS_ACCESS_KEY_ID`` and the like, ``AWS_PROFILE``.

    Raises:
        StorageError: there is no such profile, or there are no credentials.
        MissingExtraError: the profile needs boto3, which is not installed.
    """
    wanted = environment.get("AWS_PROFILE") or environment.get("AWS_DEFAULT_PROFILE")
    profile = _profile(wanted or "default", environment)
    endpoint = environment.get("AWS_ENDPOINT_URL_S3") or environment.get("AWS_ENDPOINT_URL")
    endpoint = endpoint or environment.get("AWS_ENDPOINT") or profile.get("endpoint_url")
    config = {"endpoint": endpoint} if endpoint else {}
    region = environment.get("AWS_REGION") or environment.get("AWS_DEFAULT_REGION")
    region = region or profile.get("region")
    if region:
        config["region"] = region
    if _is_anonymous(environment):
        return S3Settings(config, endpoint)
    if environment.get("AWS_ACCESS_KEY_ID"):
        _refuse_half("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", environment)
        return S3Settings(config, endpoint)
    if wanted and not profile:
        raise StorageError(
            f"there is no profile {wanted!r}",
            where=f"AWS_PROFILE, {_file('credentials', environment)}",
            fix=f"write it: `aws configure --profile {wanted}`; or unset AWS_PROFILE",
        )
    if profile.get("aws_access_key_id"):
        names = {
            "aws_access_key_id": "access_key_id",
            "aws_secret_access_key": "secret_access_key",
            "aws_session_token": "session_token",
        }
        config |= {ours: profile[theirs] for theirs, ours in names.items() if theirs in profile}
        return S3Settings(config, endpoint)
    if any(key in profile for key in _BY_SERVICE):
        return S3Settings(config, endpoint, _fetched(wanted))
    if environment.get("AWS_SECRET_ACCESS_KEY"):
        _refuse_half("AWS_SECRET_ACCESS_KEY", "AWS_ACCESS_KEY_ID", environment)
    if not any(environment.get(name) for name in _OF_THE_MACHINE):
        _refuse_nobody(environment)
    return S3Settings(config, endpoint)


def _is_anonymous(environment: Mapping[str, str]) -> bool:
    return environment.get("AWS_SKIP_SIGNATURE", "").lower() in {"1", "true"}


def _refuse_half(given: str, wanted: str, environment: Mapping[str, str]) -> None:
    if not environment.get(wanted):
        raise StorageError(
            f"half of the credentials is missing: {given} is set, {wanted} is not",
            where=wanted,
            fix=f"set {wanted}, too; or unset {given} and set AWS_PROFILE",
        )


def _refuse_nobody(environment: Mapping[str, str]) -> None:
    if environment.get("AWS_EC2_METADATA_DISABLED", "").lower() == "true":
        raise no_credentials("s3://")
    # Else a machine of Amazon's may know who it is: asking it is left to the request.


def no_credentials(where: object) -> StorageError:
    """Compose the error for a process that is nobody."""
    protocol = str(where).partition("://")[0]
    return StorageError(
        "there are no credentials for the object storage",
        where=where,
        fix=_WHO_ELSE.get(protocol, _WHO),
    )


def _fetched(profile: str | None) -> Any:  # noqa: ANN401  # obstore's provider
    try:
        import boto3
        from obstore.auth.boto3 import Boto3CredentialProvider
    except ImportError as error:
        raise MissingExtraError(
            f"the profile {profile or 'default'!r} fetches its credentials, which boto3 does",
            where="AWS_PROFILE",
            fix="pip install boto3; or put the credentials into the environment: "
            "`eval $(aws configure export-credentials --format env)`",
        ) from error
    return Boto3CredentialProvider(boto3.Session(profile_name=profile))


def _file(name: str, environment: Mapping[str, str]) -> Path:
    variable = {"credentials": "AWS_SHARED_CREDENTIALS_FILE", "config": "AWS_CONFIG_FILE"}[name]
    return Path(environment.get(variable) or Path("~/.aws").expanduser() / name)


def _profile(name: str, environment: Mapping[str, str]) -> dict[str, str]:
    """Return what both files say of a profile; {} when there is none."""
    found: dict[str, str] = {}
    in_config = name if name == "default" else f"profile {name}"
    for file, section in (("config", in_config), ("credentials", name)):
        parser = configparser.RawConfigParser()
        try:
            parser.read(_file(file, environment), encoding="utf-8")
        except (configparser.Error, OSError, UnicodeDecodeError):
            continue  # another program's file: what it says cannot be had
        if parser.has_section(section):
            found |= dict(parser.items(section))
    return found
