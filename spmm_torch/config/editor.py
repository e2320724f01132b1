"""Settings of the editor in the browser; without torch, so that help texts are quick."""

from __future__ import annotations

from dataclasses import dataclass

from .schema import check_settings, setting


@dataclass(frozen=True)
class EditorSettings:
    """Size of the pictures and address of the server.

    Raises:
        ConfigError: a value out of its range.
    """

    size: int = setting(256, "width and height of the pictures in pixels", low=64, high=1024)
    host: str = setting("localhost", "address to listen at")
    port: int = setting(0, "port to listen at; 0: any free port", low=0, high=65535)

    def __post_init__(self) -> None:
        check_settings(self)
